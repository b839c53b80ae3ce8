//! Watertightness (case 19): from inside a closed mesh nothing escapes, through edges and
//! vertices included, and every crossing is counted once.
//!
//! `TESSERA_RAYS` sets the number of rays a mesh (default 400,000).

use std::io::Read;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, dvec3};
use rayon::prelude::*;
use tessera_tests::exact;
use tessera_tests::generate::{Document, Look, Mesh, Random, icosphere, knot, torus};
use tessera_tests::subject::Subject;

fn rays() -> u64 {
    std::env::var("TESSERA_RAYS").ok().and_then(|s| s.parse().ok()).unwrap_or(400_000)
}

fn document(mesh: &Mesh) -> Document {
    let mut d = Document::new(DVec3::ZERO, DVec3::Z);
    for i in 0..mesh.faces.len() {
        d = d.triangle(mesh.corners(i), Look::default_matte());
    }
    d
}

/// A point on an edge, on a vertex, or exactly between two vertices.
fn aim(mesh: &Mesh, edges: &[[usize; 2]], random: &mut Random) -> DVec3 {
    let [a, b] = edges[random.below(edges.len() as u64) as usize].map(|i| mesh.vertices[i]);
    match random.below(4) {
        0 => a,
        1 => (a + b) * 0.5,
        _ => a + (b - a) * random.unit(),
    }
}

/// Shoots at edges and vertices from places inside; `inside` gives one for a seed.
fn is_watertight(name: &str, mesh: &Mesh, inside: impl Fn(&mut Random) -> DVec3 + Sync) {
    let (subject, edges) = (Subject::new(&document(mesh)), mesh.edges());
    assert_eq!(2 * edges.len(), 3 * mesh.faces.len(), "{name} is closed");
    let escapes = AtomicU64::new(0);
    const RUN: u64 = 4096;
    (0..rays().div_ceil(RUN)).into_par_iter().for_each(|run| {
        let random = &mut Random::new(run + 1);
        for _ in 0..RUN {
            let o = inside(random);
            let d = aim(mesh, &edges, random) - o;
            if subject.hit(o, d).is_none() && escapes.fetch_add(1, Ordering::Relaxed) < 3 {
                println!("{name}: escapes from {o:?} along {d:?}");
            }
        }
    });
    assert_eq!(escapes.into_inner(), 0, "{name}: rays escape");
}

#[test]
fn case_19_icosphere() {
    let mesh = icosphere(4);
    is_watertight("icosphere", &mesh, |random| random.cube() * 0.5);
    is_watertight("icosphere-centre", &mesh, |_| DVec3::ZERO);
}

#[test]
fn case_19_far_from_the_origin() {
    let offset = dvec3(1e6, -3e6, 2e6);
    let mesh = icosphere(4).map(|v| v * dvec3(1.0, 1e-4, 30.0) + offset);
    is_watertight("flat-ellipsoid", &mesh, |random| random.cube() * dvec3(0.5, 5e-5, 15.0) + offset);
}

#[test]
fn case_19_torus() {
    is_watertight("torus", &torus(96, 48, 2.0, 0.7), |random| {
        let a = random.between(0.0, std::f64::consts::TAU);
        dvec3(libm::cos(a), 0.0, libm::sin(a)) * 2.0 + random.cube() * 0.2
    });
}

#[test]
fn case_19_knot() {
    let mesh = knot(185, 30);
    let n = mesh.vertices.len() as u64 / 30;
    is_watertight("knot", &mesh, |random| {
        // The middle of a ring of the tube.
        let ring = random.below(n) as usize * 30;
        mesh.vertices[ring..ring + 30].iter().sum::<DVec3>() / 30.0
    });
}

#[test]
fn case_19_every_crossing_is_counted_once() {
    // Along a ray through an edge the nearest hit is one triangle: the first in the document
    // of all that exact arithmetic says are met there.
    let mesh = icosphere(2);
    let (document, edges) = (document(&mesh), mesh.edges());
    let subject = Subject::new(&document);
    let random = &mut Random::new(19);
    for _ in 0..3000 {
        let o = random.cube() * 0.5;
        let d = aim(&mesh, &edges, random) - o;
        let triangles = subject.scene().triangles();
        let met: Vec<(u32, exact::Distance)> =
            triangles.iter().filter_map(|t| exact::to_triangle(t, o, d).map(|at| (t.order, at))).collect();
        let hit = subject.hit(o, d).expect("the mesh is closed");
        // From inside a convex mesh every triangle met is met at one place.
        assert_eq!(met.first().map(|m| m.0), Some(hit.order), "{o:?} {d:?}: {met:?}");
        assert!(met.iter().all(|(_, t)| t.within_an_ulp(hit.t)), "{o:?} {d:?}");
    }
}

/// The scanned dragon, where its files are beside the checkout.
#[test]
fn case_19_scanned_mesh() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/dragon_vrip_res4.ply.gz");
    let Some(mesh) = read_ply(&path) else {
        println!("skipped: no mesh at {path:?}");
        return;
    };
    // The scan has holes: what escapes must be what exact arithmetic lets escape.
    let (subject, edges) = (Subject::new(&document(&mesh)), mesh.edges());
    let centre = mesh.vertices.iter().sum::<DVec3>() / mesh.vertices.len() as f64;
    let wrong: u64 = (0..1000u64)
        .into_par_iter()
        .map(|run| {
            let random = &mut Random::new(run);
            let (o, target) = (centre + random.cube() * 0.02, aim(&mesh, &edges, random));
            let triangles = subject.scene().triangles().iter();
            let all = triangles.filter_map(|t| exact::to_triangle(t, o, target - o));
            let hit = subject.hit(o, target - o);
            let right = match hit {
                None => all.count() == 0,
                // No distance is surely below the nearest, and one is it.
                Some(h) => {
                    let (mut nearest, mut below) = (false, false);
                    for t in all {
                        nearest |= t.within_an_ulp(h.t);
                        below |= t.compare(h.t.next_down()) == std::cmp::Ordering::Less;
                    }
                    nearest && !below
                }
            };
            u64::from(!right)
        })
        .sum();
    assert_eq!(wrong, 0);
}

/// An ASCII PLY of triangles, by the system's gzip.
fn read_ply(path: &Path) -> Option<Mesh> {
    if !path.exists() {
        return None;
    }
    let mut text = String::new();
    let mut child =
        std::process::Command::new("gzip").arg("-dc").arg(path).stdout(std::process::Stdio::piped()).spawn().ok()?;
    child.stdout.take()?.read_to_string(&mut text).ok()?;
    child.wait().ok()?;
    let (head, body) = text.split_once("end_header\n")?;
    let count = |what: &str| head.lines().find_map(|l| l.strip_prefix(what)?.trim().parse::<usize>().ok());
    let (vertices, faces) = (count("element vertex")?, count("element face")?);
    let mut lines = body.lines();
    let vertices = lines
        .by_ref()
        .take(vertices)
        .map(|l| {
            let mut n = l.split_whitespace().map(str::parse::<f64>);
            let mut next = || n.next()?.ok();
            Some(dvec3(next()?, next()?, next()?))
        })
        .collect::<Option<Vec<_>>>()?;
    let faces = lines
        .take(faces)
        .map(|l| {
            let mut n = l.split_whitespace().skip(1).map(str::parse::<usize>);
            let mut next = || n.next()?.ok();
            Some([next()?, next()?, next()?])
        })
        .collect::<Option<Vec<_>>>()?;
    Some(Mesh { vertices, faces })
}
