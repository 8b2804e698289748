//! What a result depends on beside parameters, files and inputs: the version of a program.
//!
//! A node asks the machine one [`Question`]; the answer is part of its key. An answer is remembered
//! together with what it was read from, its witnesses (a program, a folder of packages), and holds as
//! long as each of them looks the same from outside. So a run that has nothing to do starts no process.

use std::{collections::BTreeMap, fs, io, path::PathBuf};

use serde::{Deserialize, Serialize};

use super::{
    digest::Digest,
    file_digests::{identity, is_settled},
    store::{Note, Store, StoreError},
};

/// By name, as keys and `explain` show them: `python` is `CPython 3.12.4`.
pub type Facts = BTreeMap<String, String>;

/// Asks the machine.
pub type AskFn = Box<dyn Fn() -> Result<Answer, String> + Send + Sync>;

/// What a node asks the machine.
pub struct Question {
    /// All that the answer depends on beside its witnesses: equal texts have equal answers.
    pub text: String,
    /// Finds the answer, whatever that costs. Fails with a message for the user.
    pub ask: AskFn,
}

/// What the machine answers.
pub struct Answer {
    pub facts: Facts,
    /// Files and folders without whose change the answer stays. They need not exist.
    /// `None` if there is no telling; such an answer is not remembered.
    pub witnesses: Option<Vec<PathBuf>>,
}

impl Question {
    /// What the answer is remembered by.
    pub fn digest(&self) -> Digest {
        Digest::of(self.text.as_bytes())
    }
}

/// The answer, from memory if all its witnesses still look the same.
///
/// # Errors
/// See [`Question::ask`].
pub fn answer(store: &Store, question: &Question) -> Result<Facts, String> {
    let subject = question.digest();
    let stored = store.recall(Note::Facts, &subject);
    if let Some(remembered) = stored.and_then(|it| serde_json::from_slice::<Remembered>(&it).ok())
        && remembered.holds()
    {
        return Ok(remembered.facts);
    }
    let answer = (question.ask)()?;
    if let Some(remembered) = Remembered::new(&answer) {
        let payload = serde_json::to_vec(&remembered).expect("facts are plain data");
        if let Err(StoreError { error, .. }) = store.remember(vec![(Note::Facts, subject, payload)])
        {
            tracing::debug!(%error, "a fact is not remembered");
        }
    }
    Ok(answer.facts)
}

#[derive(Serialize, Deserialize)]
struct Remembered {
    facts: Facts,
    /// What each looked like; `None` if it was not there.
    witnesses: Vec<(PathBuf, Option<Digest>)>,
}

impl Remembered {
    /// `None` if a witness changed so recently that another change may look the same.
    fn new(answer: &Answer) -> Option<Self> {
        let mut witnesses = Vec::new();
        for path in answer.witnesses.as_ref()? {
            let look = match fs::metadata(path) {
                Ok(meta) => Some(is_settled(&meta).then(|| identity(path, &meta))?),
                Err(error) if error.kind() == io::ErrorKind::NotFound => None,
                Err(_) => return None,
            };
            witnesses.push((path.clone(), look));
        }
        Some(Self { facts: answer.facts.clone(), witnesses })
    }

    fn holds(&self) -> bool {
        self.witnesses.iter().all(|(path, look)| match fs::metadata(path) {
            Ok(meta) => *look == Some(identity(path, &meta)),
            Err(error) => look.is_none() && error.kind() == io::ErrorKind::NotFound,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::{
        sync::{
            Arc,
            atomic::{AtomicUsize, Ordering},
        },
        time::{Duration, SystemTime},
    };

    use super::*;
    use crate::engine::store::Access;

    /// A file that nobody has touched for an hour.
    fn write_settled(path: &std::path::Path, text: &str, hours_ago: u64) {
        fs::write(path, text).unwrap();
        let time = SystemTime::now() - Duration::from_secs(3600 * hours_ago);
        fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
    }

    #[test]
    fn an_answer_holds_while_its_witnesses_look_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let (tool, missing) = (folder.path().join("tool"), folder.path().join("missing"));
        write_settled(&tool, "1", 2);
        let store = Store::open(&folder.path().join("cache"), Access::ReadWrite).unwrap();
        let n_asked = Arc::new(AtomicUsize::new(0));
        let question = |witnesses: Option<Vec<PathBuf>>| {
            let (n_asked, tool) = (Arc::clone(&n_asked), tool.clone());
            let ask = move || {
                n_asked.fetch_add(1, Ordering::SeqCst);
                let version = fs::read_to_string(&tool).map_err(|e| e.to_string())?;
                let facts = Facts::from([("tool".to_owned(), version)]);
                Ok(Answer { facts, witnesses: witnesses.clone() })
            };
            Question { text: "tool".to_owned(), ask: Box::new(ask) }
        };
        let known = question(Some(vec![tool.clone(), missing.clone()]));
        let check = |question: &Question, version: &str, asked: usize| {
            let before = n_asked.load(Ordering::SeqCst);
            assert_eq!(answer(&store, question).unwrap()["tool"], version);
            assert_eq!(n_asked.load(Ordering::SeqCst) - before, asked);
        };
        check(&known, "1", 1);
        check(&known, "1", 0);
        write_settled(&tool, "2", 1);
        check(&known, "2", 1);
        check(&known, "2", 0);
        write_settled(&missing, "", 1);
        check(&known, "2", 1);
        fs::write(&tool, "3").unwrap();
        check(&known, "3", 1);
        check(&known, "3", 1);
        let unknown = question(None);
        fs::remove_file(&missing).unwrap();
        check(&unknown, "3", 1);
        check(&unknown, "3", 1);
    }
}
