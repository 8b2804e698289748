//! The examples of `docs/figures.md`, through the program. With `UPDATE=1` their pictures are drawn anew.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("docs")
}

/// A folder with the tables that the examples read.
fn folder_with_tables() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("figures")).unwrap();
    for entry in fs::read_dir(docs().join("figures")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|it| it == "csv" || it == "toml") {
            fs::copy(&path, folder.path().join("figures").join(path.file_name().unwrap())).unwrap();
        }
    }
    folder
}

/// Runs a pipeline; its exit code and what it said.
fn run(folder: &Path, pipeline: &str) -> (Option<i32>, String) {
    fs::write(folder.join("pipeline.toml"), pipeline).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .args(["run", "pipeline.toml"])
        .current_dir(folder)
        .env_remove("SINEW_CACHE")
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

/// The code blocks of a Markdown file in one language.
fn blocks<'a>(text: &'a str, language: &str) -> Vec<&'a str> {
    let parts = text.split("```").skip(1).step_by(2);
    parts.filter_map(|it| it.strip_prefix(language)?.strip_prefix('\n')).collect()
}

/// The names of the elements of an SVG and the texts between them, in order; open elements are closed in
/// their order, or the file is no XML.
fn elements(svg: &str) -> Vec<String> {
    let mut res = Vec::new();
    let mut open: Vec<String> = Vec::new();
    for part in svg.split('<').skip(1) {
        let (tag, text) = part.split_once('>').unwrap_or_else(|| panic!("an open tag: {part}"));
        let name = tag.split([' ', '/']).find(|it| !it.is_empty()).unwrap().to_owned();
        match (tag.starts_with('/'), tag.ends_with('/')) {
            (true, _) => assert_eq!(open.pop(), Some(name)),
            (false, is_empty) => {
                assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
                res.push(name.clone());
                if !is_empty {
                    open.push(name);
                }
            }
        }
        if !text.trim().is_empty() {
            res.push(text.to_owned());
        }
    }
    assert!(open.is_empty(), "{open:?} are not closed");
    res
}

#[test]
fn the_documented_figures_are_what_the_program_draws() {
    let text = fs::read_to_string(docs().join("figures.md")).unwrap();
    let folder = folder_with_tables();
    let mut styles = Vec::new();
    for block in blocks(&text, "toml") {
        let (code, said) = run(folder.path(), block);
        assert_eq!(code, Some(0), "{block}\n{said}");
        let quoted_after = |key: &str| {
            let rest = block.split_once(&format!("\n{key} = \""))?.1;
            Some(rest.split('"').next().unwrap())
        };
        styles.extend(quoted_after("figure"));
        for output in block.lines().filter_map(|it| it.strip_prefix("\"out/")?.split('"').next()) {
            let written = folder.path().join("out").join(output);
            if output.ends_with(".png") {
                assert!(fs::read(&written).unwrap().starts_with(b"\x89PNG"), "{output}");
            } else {
                assert_documented(&written, &docs().join("figures").join(output));
            }
        }
    }
    styles.sort_unstable();
    assert_eq!(styles, ["bars", "box", "cdf", "curve", "scatter"], "one example a style");
}

/// Places may move in the last digit from one processor to another; texts and elements may not.
fn assert_documented(written: &Path, committed: &Path) {
    let drawn = fs::read_to_string(written).unwrap();
    if std::env::var_os("UPDATE").is_some() {
        fs::write(committed, &drawn).unwrap();
    }
    let known = fs::read_to_string(committed).unwrap_or_default();
    let is_svg = written.extension().is_some_and(|it| it == "svg");
    let place = committed.display();
    if is_svg {
        assert!(elements(&drawn) == elements(&known), "{place}: `UPDATE=1 cargo test` draws it");
    } else {
        assert_eq!(drawn, known, "{place}: `UPDATE=1 cargo test` writes it");
    }
}

#[test]
fn a_check_fails_the_run_and_what_follows_is_not_made() {
    let folder = folder_with_tables();
    let pipeline = |max: f64| {
        format!(
            "[nodes.joints]\nkind = \"table_file\"\npath = \"figures/joint_errors.csv\"\n\n\
             [nodes.good_enough]\nkind = \"check\"\nrows = \"@joints\"\ncolumn = \"error of height\"\n\
             where = {{ pair = \"horse to cow\" }}\nstatistic = \"mean\"\nmax = {max:?}\n\
             message = \"the cow got worse\"\n\n[nodes.shown]\nkind = \"table\"\n\
             rows = \"@good_enough\"\n\n[outputs]\n\"out/shown.csv\" = \"@shown\"\n"
        )
    };
    let (code, said) = run(folder.path(), &pipeline(4.0));
    assert_eq!(code, Some(1), "{said}");
    let fact = "the cow got worse: `mean` of `error of height` is ";
    assert!(said.contains(fact) && said.contains(" %, above the bound of 4 %"), "{said}");
    assert!(!folder.path().join("out/shown.csv").exists());
    let (code, said) = run(folder.path(), &pipeline(6.0));
    assert_eq!(code, Some(0), "{said}");
    let text = fs::read_to_string(folder.path().join("out/shown.csv")).unwrap();
    let source = fs::read_to_string(folder.path().join("figures/joint_errors.csv")).unwrap();
    assert_eq!(text, source, "a table goes through a check unchanged, and through CSV too");
}

#[test]
fn an_axis_is_a_column_and_an_item_that_failed_a_row() {
    let folder = folder_with_tables();
    for (name, text) in
        [("20", "error [%]\n4\n6\n"), ("40", "error [%]\n1,2\n"), ("60", "error [%]\n1\n")]
    {
        fs::write(folder.path().join(format!("{name}.csv")), text).unwrap();
    }
    let pipeline = "[axes.k]\nvalues = [20, 40, 60]\n\n\
                    [nodes.errors]\nkind = \"table_file\"\npath = \"${k}.csv\"\n\n\
                    [nodes.all]\nkind = \"table\"\nrows = \"@errors\"\nover = [\"k\"]\n\
                    missing = \"show\"\nstatistics = [\"mean\"]\n\n\
                    [nodes.drawn]\nkind = \"plot\"\nrows = \"@errors\"\nover = [\"k\"]\n\
                    missing = \"show\"\nfigure = \"curve\"\nx = \"k\"\ny = \"error\"\n\n\
                    [outputs]\n\"all.csv\" = \"@all\"\n\"all.svg\" = \"@drawn\"\n";
    let (code, said) = run(folder.path(), pipeline);
    assert_eq!(code, Some(1), "something failed, and the exit code says so: {said}");
    assert!(said.contains("`error` is missing in 1 of 4 rows; 3 are left"), "{said}");
    let text = fs::read_to_string(folder.path().join("all.csv")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "statistic,k,error [%],missing");
    assert_eq!([lines[1], lines[2], lines[4]], [",20,4,", ",20,6,", ",60,1,"]);
    let why = "it has 2 fields, but the header has 1";
    assert!(lines[3].starts_with(",40,,") && lines[3].contains(why), "{text}");
    assert!(lines[5].starts_with("mean,,3.66666") && lines[6] == "missing,,1,", "{text}");
    let svg = fs::read_to_string(folder.path().join("all.svg")).unwrap();
    let texts = elements(&svg);
    assert!(
        ["error [%]", "k", "20", "60"].iter().all(|it| texts.contains(&(*it).to_owned())),
        "{svg}"
    );
}

#[test]
fn mistakes_are_told_before_or_at_their_node() {
    let folder = folder_with_tables();
    let plot = |lines: &str| {
        format!(
            "[nodes.joints]\nkind = \"table_file\"\npath = \"figures/joint_errors.csv\"\n\n\
             [nodes.drawn]\nkind = \"plot\"\nrows = \"@joints\"\n{lines}\n"
        )
    };
    let check = |lines: &str, code: i32, expected: &str| {
        let (found, said) = run(folder.path(), &plot(lines));
        assert!(found == Some(code) && said.contains(expected), "{lines}: {found:?}\n{said}");
    };
    check("figure = \"cdf\"\nx = \"error\"\nfit = true", 2, "`fit` does not belong to the figure");
    check("figure = \"bars\"\nx = \"pair\"", 2, "figure \"bars\" needs `y`, the name of a column");
    check("figure = \"pie\"", 2, "`figure` cannot be \"pie\"");
    check("figure = \"curve\"\nx = \"pair\"\ny = 3", 2, "`y` must be");
    check(
        "figure = \"curve\"\nx = \"pair\"\ny = \"error of height\"",
        1,
        "column `pair` holds texts, but an axis of numbers needs numbers",
    );
    check("figure = \"box\"\ny = \"eror\"", 1, "there is no column `eror`; there are `pair`, ");
}
