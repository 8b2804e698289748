//! The pipelines of the README, through the program, as their users run them.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Runs a pipeline of the repository in a folder of its own; returns what it said.
fn run(folder: &Path, pipeline: &str, args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_sinew"))
        .arg("run")
        .arg(root().join("pipelines").join(pipeline))
        .args(args)
        .current_dir(folder)
        .env_remove("SINEW_CACHE")
        .output()
        .unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{text}");
    text
}

/// The named column of a written CSV table.
fn column(file: &Path, name: &str) -> Vec<f64> {
    let text = fs::read_to_string(file).unwrap();
    let mut lines = text.lines().map(|it| it.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let index = head.iter().position(|it| it.starts_with(name)).unwrap_or_else(|| {
        panic!("no column `{name}` in {head:?}");
    });
    lines.map(|it| it[index].parse().unwrap()).collect()
}

#[test]
fn the_quick_start_transfers_a_skeleton_once_and_after_a_change_only_what_changed() {
    let folder = tempfile::tempdir().unwrap();
    let small = ["--set", "n_vertices=2500"];
    let first = run(folder.path(), "quickstart.toml", &small);
    assert!(first.contains("21 ran"), "{first}");
    let out = folder.path().join("out/quickstart");
    for file in ["rigged.glb", "joint_error.csv", "joint_error.md", "summary.md", "picture.png"] {
        assert!(fs::metadata(out.join(file)).unwrap().len() > 100, "{file}");
    }
    assert!(fs::read(out.join("rigged.glb")).unwrap().starts_with(b"glTF"));
    assert!(fs::read(out.join("picture.png")).unwrap().starts_with(b"\x89PNG"));
    let errors = column(&out.join("joint_error.csv"), "error");
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    // Metres: the body is 1.7 m tall, so this is 1.5 % of its height.
    assert!(errors.len() == 22 && mean < 0.025, "{mean} m");

    let second = run(folder.path(), "quickstart.toml", &small);
    assert!(second.contains("21 nodes up to date"), "{second}");

    let changed =
        run(folder.path(), "quickstart.toml", &["--set", "n_vertices=2500", "--set", "k=60"]);
    assert!(changed.contains("15 ran, 6 cached"), "{changed}");
    assert!(changed.contains("transfer/source_basis"), "{changed}");
    assert!(changed.contains("`k`: 120 -> 60"), "{changed}");
}

#[test]
fn results_are_the_same_bytes_at_one_and_two_threads() {
    let outputs = |threads: &str| {
        let folder = tempfile::tempdir().unwrap();
        run(folder.path(), "quickstart.toml", &["--set", "n_vertices=1500", "-j", threads]);
        let mut files: Vec<PathBuf> = fs::read_dir(folder.path().join("out/quickstart"))
            .unwrap()
            .map(|it| it.unwrap().path())
            .collect();
        files.sort();
        files.iter().map(|it| fs::read(it).unwrap()).collect::<Vec<_>>()
    };
    assert!(outputs("1") == outputs("2"));
}

#[test]
fn a_cloud_and_a_broken_mesh_get_skeletons_as_good_as_the_clean_mesh_does() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "point_cloud.toml", &["--set", "n_vertices=2500", "--set", "k=80"]);
    let means = column(&folder.path().join("out/point_cloud/errors.csv"), "mean of height");
    let [mesh, broken, vertices, scan] = means[..] else { panic!("{means:?}") };
    assert!(mesh < 2.0, "{means:?} % of the height");
    for other in [broken, vertices, scan] {
        assert!(other < mesh + 1.0, "{means:?} % of the height");
    }
}

#[test]
fn a_sweep_computes_what_depends_on_it_and_gathers_the_rest() {
    let folder = tempfile::tempdir().unwrap();
    let small = ["--set", "n_vertices=1500", "--limit", "k=2"];
    let first = run(folder.path(), "sweep.toml", &[&small[..], &["--limit", "body=2"]].concat());
    assert!(first.contains("transfer/target_basis@2,40"), "{first}");
    // Laplacians do not depend on the sweep: one a body.
    assert_eq!(first.matches("ran  transfer/target_laplacian").count(), 2, "{first}");
    let rows = folder.path().join("out/sweep/rows.csv");
    assert_eq!(column(&rows, "body"), [2.0, 2.0, 3.0, 3.0]);
    assert_eq!(column(&rows, "k"), [40.0, 80.0, 40.0, 80.0]);
    assert!(column(&rows, "mean of height").iter().all(|it| *it < 3.0));
    for file in ["errors.md", "errors.tex", "curve.svg", "curve.png", "cdf.png"] {
        assert!(fs::metadata(folder.path().join("out/sweep").join(file)).unwrap().len() > 100);
    }
    let more = run(folder.path(), "sweep.toml", &[&small[..], &["--only", "body=2,3,5"]].concat());
    assert!(more.contains("ran  target@5") && !more.contains("ran  target@2"), "{more}");
    assert_eq!(more.matches("ran  transfer/target_laplacian").count(), 1, "{more}");
}

#[test]
fn people_of_a_table_get_the_skeleton_of_one_adult() {
    let mirror = root().join("../shared/data");
    if !mirror.join("makehuman").is_dir() {
        eprintln!("skipped: the corpus is not there");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mirror = mirror.display().to_string();
    let some = ["--only", "person=boy,man_strong", "--mirror", &mirror, "--offline"];
    run(folder.path(), "population.toml", &some);
    let out = folder.path().join("out/population");
    assert!(out.join("boy.glb").is_file() && !out.join("woman.glb").exists());
    let errors = column(&out.join("errors.csv"), "mean of height");
    assert!(errors.len() == 6 && errors[..2].iter().all(|it| *it < 1.5), "{errors:?} %");
}

#[test]
fn real_shapes_get_skeletons_as_good_as_the_readme_says() {
    let mirror = root().join("../shared/data");
    if !mirror.join("makehuman").is_dir() {
        eprintln!("skipped: the corpus is not there");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mirror = mirror.to_str().unwrap();
    run(folder.path(), "functional_transfer.toml", &["--offline", "--mirror", mirror]);
    let table = folder.path().join("out/functional_transfer/errors.csv");
    let means = column(&table, "mean of height");
    for (mean, bound) in means.iter().zip([1.2, 1.2, 6.0, 5.0]) {
        assert!(*mean < bound, "{means:?} % of the heights");
    }
    assert_eq!(means.len(), 4);
}

#[test]
fn an_embedded_skeleton_is_near_the_true_one() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "embed.toml", &["--set", "n_vertices=2000"]);
    let out = folder.path().join("out/embed");
    let means = column(&out.join("error.csv"), "mean of height");
    assert!(means[0] < 6.0, "{means:?} % of the height");
    let matched = column(&out.join("joints.csv"), "matched");
    assert!(matched.len() == 22 && matched.iter().sum::<f64>() >= 20.0, "{matched:?}");
    assert!(fs::read(out.join("target.glb")).unwrap().starts_with(b"glTF"));
}

#[test]
fn a_depth_video_moves_another_body() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "transfer4d.toml", &["--set", "frames=8", "--set", "shown=6"]);
    let out = folder.path().join("out/transfer4d");
    let matched = column(&out.join("joints.csv"), "matched");
    let n_matched = matched.iter().sum::<f64>();
    assert!(matched.len() >= 15 && n_matched >= 0.9 * matched.len() as f64, "{matched:?}");
    assert!(fs::read(out.join("target.glb")).unwrap().starts_with(b"glTF"));
}

#[test]
fn a_bare_body_walks_by_its_curve_skeleton() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), "skeleton_matching.toml", &[]);
    let out = folder.path().join("out/skeleton_matching");
    // Two metres from corner to corner, so this is 3 % of the body's diagonal.
    let error = column(&out.join("error.csv"), "local pose error at diagonal 2")[0];
    assert!(error < 0.06, "{error}");
    // Head, hands, feet, hips and chest; the mirrored match is second and far worse.
    let matches = fs::read_to_string(out.join("matches.csv")).unwrap();
    assert!(matches.lines().nth(1).unwrap().contains(",7,6,"), "{matches}");
    let places: Vec<f64> = (matches.lines().skip(1).take(2))
        .map(|line| line.split(',').nth(2).unwrap().parse().unwrap())
        .collect();
    assert!(places[1] > 1.5 * places[0], "{places:?}");
    assert!(fs::read(out.join("target.glb")).unwrap().starts_with(b"glTF"));
}

#[test]
fn every_pipeline_is_right() {
    let has_corpus = root().join("../shared/data/humans_posed").is_dir();
    let mut n_checked = 0;
    for folder in ["pipelines", "pipelines/papers", "pipelines/peers"] {
        for entry in fs::read_dir(root().join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|it| it != "toml") {
                continue;
            }
            if path.to_string_lossy().ends_with("_corpus.toml") && !has_corpus {
                eprintln!("skipped: the corpus that `{}` reads is not there", path.display());
                continue;
            }
            let output =
                Command::new(env!("CARGO_BIN_EXE_sinew")).arg("check").arg(&path).output().unwrap();
            let text = String::from_utf8(output.stderr).unwrap();
            assert!(output.status.success(), "{text}");
            n_checked += 1;
        }
    }
    assert!(n_checked > 9, "{n_checked}");
}

#[test]
fn the_first_table_of_the_functional_transfer_has_the_papers_numbers_beside_ours() {
    let mirror = root().join("../shared/data");
    if !mirror.join("makehuman").is_dir() {
        eprintln!("skipped: the corpus is not there");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let mirror = mirror.to_str().unwrap();
    let one = ["adult=1", "child=1", "animal=1", "seed=1"].map(|it| ["--limit", it]).concat();
    let args = [&one[..], &["--offline", "--mirror", mirror, "--set", "k=60"]].concat();
    run(folder.path(), "papers/functional_table1.toml", &args);
    let out = folder.path().join("out/papers/functional_table1");
    let means = column(&out.join("rows.csv"), "mean of height");
    // Adults, clouds, children, animals of one model, animals of one rig; functional, pointwise, surface.
    assert_eq!(means.len(), 15);
    assert!(means[..12].iter().all(|it| *it < 4.0), "{means:?}");
    assert!(means[12..].iter().all(|it| *it < 12.0), "{means:?}");
    let table = fs::read_to_string(out.join("table.md")).unwrap();
    assert!(table.contains("animals (SMAL)") && table.contains("0.0692"), "{table}");
}
