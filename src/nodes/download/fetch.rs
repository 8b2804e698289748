//! One file over the network.

use std::{path::PathBuf, thread, time::Duration};

use ureq::Agent;

use crate::engine::node::{NodeError, Surroundings};
use crate::kernels::io::uri::percent_decoded;

const CONNECT_TIMEOUT: Duration = Duration::from_secs(15);
const TOTAL_TIMEOUT: Duration = Duration::from_secs(600);
const N_TRIES: u32 = 3;
/// Larger files do not belong into a pipeline's memory.
const MAX_BYTES: u64 = 4 << 30;

pub struct Fetcher {
    agent: Agent,
    offline: bool,
    mirrors: Vec<PathBuf>,
    first_pause: Duration,
}

impl Fetcher {
    pub fn new(surroundings: &Surroundings) -> Self {
        let config = Agent::config_builder()
            .timeout_connect(Some(CONNECT_TIMEOUT))
            .timeout_global(Some(TOTAL_TIMEOUT))
            .build();
        Self {
            agent: config.into(),
            offline: surroundings.offline,
            mirrors: surroundings.mirrors.clone(),
            first_pause: Duration::from_secs(1),
        }
    }

    /// Fetches a URL and checks its content.
    pub fn fetch(&self, url: &str, digest: blake3::Hash) -> Result<Vec<u8>, NodeError> {
        let bytes = match url.strip_prefix("data:,") {
            Some(data) => percent_decoded(data)
                .ok_or_else(|| NodeError::failed("the `data:` URL is not percent-encoded"))?,
            None if self.offline => return Err(self.offline_error(url)),
            None => self.with_retries(url)?,
        };
        let got = blake3::hash(&bytes);
        if got == digest {
            return Ok(bytes);
        }
        Err(NodeError::failed(format!(
            "`{url}` has the blake3 {got} ({} bytes), but {digest} is expected",
            bytes.len()
        )))
    }

    fn offline_error(&self, url: &str) -> NodeError {
        let searched: Vec<String> =
            self.mirrors.iter().map(|it| format!("`{}`", it.display())).collect();
        let searched = if searched.is_empty() {
            "no mirror is set (`SINEW_MIRROR`)".to_owned()
        } else {
            format!("not in the mirrors {}", searched.join(", "))
        };
        NodeError::environment(format!("`{url}` is needed, but the network is off: {searched}"))
    }

    /// Tries again after failures that may pass.
    fn with_retries(&self, url: &str) -> Result<Vec<u8>, NodeError> {
        let mut pause = self.first_pause;
        for attempt in 1.. {
            match self.get(url) {
                Ok(bytes) => return Ok(bytes),
                Err(error) if attempt < N_TRIES && may_pass(&error) => thread::sleep(pause),
                Err(error) => {
                    let tries =
                        if attempt == 1 { String::new() } else { format!(" ({attempt} tries)") };
                    return Err(NodeError::environment(format!(
                        "cannot fetch `{url}`: {error}{tries}"
                    )));
                }
            }
            pause *= 3;
        }
        unreachable!("attempts are counted without end")
    }

    fn get(&self, url: &str) -> Result<Vec<u8>, ureq::Error> {
        self.agent.get(url).call()?.body_mut().with_config().limit(MAX_BYTES).read_to_vec()
    }
}

/// Everything but an answer that will stay the same, or a URL that makes no sense.
fn may_pass(error: &ureq::Error) -> bool {
    match error {
        ureq::Error::StatusCode(status) => *status >= 500 || *status == 429 || *status == 408,
        ureq::Error::BadUri(_) | ureq::Error::BodyExceedsLimit(_) => false,
        _ => true,
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read, Write},
        net::TcpListener,
    };

    use super::*;

    /// Answers one request after the other with these statuses and `hello`.
    fn server(statuses: &'static [u16]) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/a.txt", listener.local_addr().unwrap());
        thread::spawn(move || {
            for status in statuses {
                let (mut stream, _) = listener.accept().unwrap();
                let _ = stream.read(&mut [0; 4096]);
                let head = format!("HTTP/1.1 {status} X\r\nContent-Length: 5\r\nConnection: close");
                let _ = stream.write_all(format!("{head}\r\n\r\nhello").as_bytes());
            }
        });
        url
    }

    fn fetcher(offline: bool) -> Fetcher {
        let surroundings = Surroundings { mirrors: Vec::new(), offline, isolated: false };
        Fetcher { first_pause: Duration::from_millis(1), ..Fetcher::new(&surroundings) }
    }

    fn error(url: &str, offline: bool) -> NodeError {
        fetcher(offline).fetch(url, blake3::hash(b"hello")).unwrap_err()
    }

    #[test]
    fn a_failure_that_passes_is_tried_again() {
        let url = server(&[503, 200]);
        assert_eq!(fetcher(false).fetch(&url, blake3::hash(b"hello")).unwrap(), b"hello");
    }

    #[test]
    fn other_bytes_are_refused_with_both_digests() {
        let url = server(&[200]);
        let error = fetcher(false).fetch(&url, blake3::hash(b"other")).unwrap_err();
        assert!(matches!(error, NodeError::Failed(_)));
        let (got, expected) = (blake3::hash(b"hello"), blake3::hash(b"other"));
        let message = format!("`{url}` has the blake3 {got} (5 bytes), but {expected} is expected");
        assert_eq!(error.message(), message);
    }

    #[test]
    fn what_is_not_there_is_not_tried_again() {
        let url = server(&[404]);
        let error = error(&url, false);
        assert!(matches!(error, NodeError::Environment(_)));
        assert_eq!(error.message(), format!("cannot fetch `{url}`: http status: 404"));
    }

    #[test]
    fn offline_says_where_it_looked() {
        let error = error("http://localhost/a", true);
        assert_eq!(
            error.message(),
            "`http://localhost/a` is needed, but the network is off: no mirror is set (`SINEW_MIRROR`)"
        );
    }

    #[test]
    fn data_urls_hold_their_bytes() {
        assert_eq!(fetcher(true).fetch("data:,a%0A", blake3::hash(b"a\n")).unwrap(), b"a\n");
    }
}
