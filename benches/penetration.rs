//! Penetrations resolved in keys a second.
//!
//! `cargo bench --bench penetration -- [runs=3] [vertices=30000] [inward_deg=0] [threads=2]`: a walk with
//! its arms turned inwards goes to a stout body, so that something penetrates in every key.

use nalgebra::UnitQuaternion;
use sinew::kernels::geometry::mesh::Vec3;
use sinew::kernels::motion::resolve_penetration::{
    KeyReport, ResolvePenetrationOptions, resolve_penetration,
};
use sinew::kernels::motion::transfer_animation::{TransferAnimationOptions, transfer_animation};
use sinew::kernels::rigs::segments_by_name::segments_by_name;
use sinew::kernels::synthetic::synthesize::{Character, Stance, SynthesizeOptions, synthesize};

fn main() {
    let threads = number("threads", 2);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(measure);
}

fn measure() {
    let (runs, n_vertices) = (number("runs", 3), number("vertices", 30_000));
    let slim = body(SynthesizeOptions { n_vertices: 1000, ..Default::default() });
    let stout =
        SynthesizeOptions { n_vertices, girth: 1.3, stance: Stance::T, ..Default::default() };
    let stout = body(stout);
    let mut clip = slim.clip.clone();
    let inward_rad = (number("inward_deg", 0) as f64).to_radians();
    for (name, angle) in [("left_arm", -inward_rad), ("right_arm", inward_rad)] {
        let joint = slim.skeleton.joint(name).expect("a biped has arms");
        for frame in 0..clip.n_frames() {
            clip.rotations[frame * clip.n_joints + joint] *=
                UnitQuaternion::from_axis_angle(&Vec3::z_axis(), angle);
        }
    }
    let map = segments_by_name(&slim.skeleton, &stout.skeleton);
    let options = TransferAnimationOptions::default();
    let moved = transfer_animation(&slim.skeleton, &clip, &stout.skeleton, &map, &options);
    let clip = moved.expect("the same joints").clip;
    let mut least = f64::INFINITY;
    let mut keys: Vec<KeyReport> = Vec::new();
    for _ in 0..runs {
        let start = std::time::Instant::now();
        let options = ResolvePenetrationOptions::default();
        let res =
            resolve_penetration(&stout.mesh, &stout.skeleton, &stout.weights, &clip, &options);
        least = least.min(start.elapsed().as_secs_f64());
        keys = res.expect("parts of one body").keys;
    }
    let pairs = |of: fn(&KeyReport) -> usize| keys.iter().map(of).sum::<usize>();
    println!(
        "{n_vertices} vertices, {} keys: {:.1} keys/s; crossing pairs {} before, {} after",
        keys.len(),
        keys.len() as f64 / least,
        pairs(|it| it.before.n_pairs),
        pairs(|it| it.after.n_pairs),
    );
}

fn body(options: SynthesizeOptions) -> Character {
    synthesize(&options).expect("a body of usual proportions")
}

/// A `name=value` word; `cargo bench` adds `--bench`, which is skipped.
fn number(name: &str, default: usize) -> usize {
    let words = std::env::args().skip(1);
    let mut value =
        words.filter_map(|it| Some(it.strip_prefix(name)?.strip_prefix('=')?.to_owned()));
    value.next_back().map_or(default, |it| it.parse().expect("a number"))
}
