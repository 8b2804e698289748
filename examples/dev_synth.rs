use sinew::kernels::{skinning, synthesize::*};
use std::fmt::Write;
fn main() {
    // body seed variation n pose conn out
    let a: Vec<String> = std::env::args().collect();
    let mut o = SynthesizeOptions::default();
    o.body = if a[1].starts_with('q') { Body::Quadruped } else { Body::Biped };
    o.seed = a[2].parse().unwrap();
    o.variation = a[3].parse().unwrap();
    o.n_vertices = a[4].parse().unwrap();
    let p = &a[5];
    o.stance = if p == "rest" {
        Stance::Rest
    } else if p == "t" {
        Stance::T
    } else if let Some(x) = p.strip_prefix('w') {
        Stance::Walk(x.parse().unwrap())
    } else if let Some(x) = p.strip_prefix('r') {
        Stance::Random(x.parse().unwrap())
    } else {
        Stance::Rest
    };
    o.connectivity = match a[6].as_str() {
        "iso" => Connectivity::Isotropic,
        "ada" => Connectivity::Adaptive,
        _ => Connectivity::Irregular,
    };
    if let Ok(h) = std::env::var("HOLES") {
        o.n_holes = h.parse().unwrap();
    }
    if let Ok(h) = std::env::var("NOISE") {
        o.noise = h.parse().unwrap();
    }
    let t = std::time::Instant::now();
    let d = synthesize(&o).unwrap();
    eprintln!(
        "{:?} V {} F {} influences {}",
        t.elapsed(),
        d.mesh.n_vertices(),
        d.mesh.n_faces(),
        d.weights.max_influences()
    );
    let mut least = 180.0_f64;
    let mut small = 0;
    let mut worst = [0.0; 3];
    for f in 0..d.mesh.n_faces() {
        let [a, b, c] = d.mesh.corners(f);
        let m = (b - a)
            .angle(&(c - a))
            .min((c - b).angle(&(a - b)))
            .min((a - c).angle(&(b - c)))
            .to_degrees();
        if m < least {
            least = m;
            worst = [a.x, a.y, a.z];
        }
        if m < 20.0 {
            small += 1;
        }
    }
    eprintln!("least angle {least:.1} at {worst:?}, below 20: {small}");
    let mut mesh = d.mesh.clone();
    let mut sk = d.skeleton.clone();
    if let Some(x) = p.strip_prefix('c') {
        let f: usize = x.parse().unwrap();
        mesh = mesh
            .with_vertices(skinning::skin(&d.mesh, &d.skeleton, &d.weights, &d.clip, f).unwrap())
            .unwrap();
        sk = sk
            .with_positions(
                skinning::world_from_joint(&d.skeleton, &d.clip, f)
                    .unwrap()
                    .iter()
                    .map(|i| i.translation.vector)
                    .collect(),
            )
            .unwrap();
    }
    write(&a[7], &mesh, &sk, &d.weights, &d.landmarks.vertices);
}
fn write(
    path: &str,
    mesh: &sinew::kernels::mesh::TriMesh,
    sk: &sinew::kernels::skeleton::Skeleton,
    w: &sinew::kernels::weights::SkinWeights,
    lm: &[u32],
) {
    let mut s = String::new();
    let col = |j: usize| {
        let h = (j as f64 * 0.381966 * 6.0) % 6.0;
        let f = |o: f64| (((h + o) % 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0) * 0.7 + 0.25;
        [f(0.0), f(4.0), f(2.0)]
    };
    for (i, v) in mesh.vertices().iter().enumerate() {
        let mut c = [0.0; 3];
        for (j, x) in w.row(i) {
            for k in 0..3 {
                c[k] += x * col(j as usize)[k];
            }
        }
        if lm.contains(&(i as u32)) {
            c = [0.0, 0.0, 0.0];
        }
        if std::env::var("PLAIN").is_ok() {
            writeln!(s, "v {} {} {}", v.x, v.y, v.z).unwrap();
        } else {
            writeln!(s, "v {} {} {} {} {} {}", v.x, v.y, v.z, c[0], c[1], c[2]).unwrap();
        }
    }
    for f in mesh.faces() {
        writeln!(s, "f {} {} {}", f[0] + 1, f[1] + 1, f[2] + 1).unwrap();
    }
    for p in sk.positions() {
        writeln!(s, "#j {} {} {}", p.x, p.y, p.z).unwrap();
    }
    for (a, b) in sk.bones() {
        writeln!(s, "#b {a} {b}").unwrap();
    }
    std::fs::write(path, s).unwrap();
}
