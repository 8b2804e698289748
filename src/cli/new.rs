//! `sinew new`: a pipeline to start from.

use std::{
    fs,
    io::{self, Write},
    path::PathBuf,
};

use super::{Exit, Failure, ui::Ui};

/// Write a pipeline that runs at once, without any data
#[derive(clap::Args)]
pub struct Args {
    /// Its file is NAME.toml
    name: PathBuf,
    /// What to start from
    #[arg(long, value_name = "NAME", default_value = "transfer")]
    template: Template,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Template {
    /// A skeleton from one body to another
    Transfer,
    /// A single body
    Blank,
}

impl Template {
    fn text(self) -> &'static str {
        match self {
            Self::Transfer => include_str!("templates/transfer.toml"),
            Self::Blank => include_str!("templates/blank.toml"),
        }
    }
}

pub fn run(args: &Args, ui: &Ui) -> Result<Exit, Failure> {
    let mut path = args.name.clone();
    if path.extension().is_none_or(|it| it != "toml") {
        path.as_mut_os_string().push(".toml");
    }
    let shown = path.display();
    let fail = |e: io::Error| match e.kind() {
        io::ErrorKind::AlreadyExists => Failure::Usage(format!("`{shown}` is there already")),
        _ => Failure::Environment(format!("cannot write `{shown}`: {e}")),
    };
    let mut file = fs::File::create_new(&path).map_err(fail)?;
    file.write_all(args.template.text().as_bytes()).map_err(fail)?;
    ui.status("Created", &format!("{shown}; now: sinew run {shown}"));
    Ok(Exit::Success)
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;
    use crate::{
        LIBRARY,
        engine::pipeline::{self, Settings},
    };

    #[test]
    fn every_template_is_sound() {
        for template in Template::value_variants() {
            let settings = Settings::default();
            let graph = pipeline::load_text(template.text(), PathBuf::new(), &LIBRARY, &settings);
            assert!(graph.is_ok(), "{template:?}\n{}", graph.err().unwrap());
        }
    }
}
