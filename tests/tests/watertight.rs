//! Watertightness (case 19): from inside a closed mesh nothing escapes, through edges and
//! vertices included, and every crossing is counted once.
//!
//! `TESSERA_RAYS` sets the number of rays a mesh (default 400,000).

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec3, dvec3};
use rayon::prelude::*;
use tessera_tests::exact;
use tessera_tests::generate::{Document, Look, Mesh, Random, icosphere, knot, read_ply, scans, torus};
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

/// The most surface that a ray may see edge-on, as a cosine.
const EDGE_ON: f64 = 1e-6;

/// An edge, and the two faces at it.
type Seam = ([usize; 2], [usize; 2]);

/// Edges between two faces that turn the same way: they run once in each direction.
fn seams(mesh: &Mesh) -> Vec<Seam> {
    let mut beside: HashMap<[usize; 2], Vec<usize>> = HashMap::new();
    for (k, f) in mesh.faces.iter().enumerate() {
        for i in 0..3 {
            beside.entry([f[i], f[(i + 1) % 3]]).or_default().push(k);
        }
    }
    let mut seams: Vec<Seam> = Vec::new();
    for (&[a, b], left) in &beside {
        if let (true, [l], Some([r])) = (a < b, &left[..], beside.get(&[b, a]).map(|r| &r[..])) {
            seams.push(([a, b], [*l, *r]));
        }
    }
    seams.sort_unstable();
    seams
}

/// A scanned mesh has holes and edges of three faces, so nothing is inside it. But a ray at an edge
/// between two faces that both face it, or both face away, crosses one of them there: it is met
/// there or before, and where it is met there, by one of the two, the first in the document of
/// those that exact arithmetic says are met.
fn crosses_every_seam(name: &str, mesh: &Mesh) {
    let seams = seams(mesh);
    // The faces around each vertex, and how many seams run into it: as many where they close around it.
    let mut around = vec![Vec::new(); mesh.vertices.len()];
    for (k, f) in mesh.faces.iter().enumerate() {
        f.iter().for_each(|&v| around[v].push(k));
    }
    let mut spokes = vec![0; mesh.vertices.len()];
    seams.iter().flat_map(|(edge, _)| edge).for_each(|&v| spokes[v] += 1);
    let normals: Vec<DVec3> = (0..mesh.faces.len())
        .map(|k| {
            let [a, b, c] = mesh.corners(k);
            (b - a).cross(c - a).normalize()
        })
        .collect();
    let centre = mesh.vertices.iter().sum::<DVec3>() / mesh.vertices.len() as f64;
    let size = mesh.vertices.iter().fold(0.0, |m: f64, v| m.max((*v - centre).length()));
    let subject = Subject::new(&document(mesh));
    const RUN: u64 = 1024;
    let triangles = subject.scene().triangles();
    let [tried, judged, there, leaks, doubles] = (0..rays().div_ceil(RUN))
        .into_par_iter()
        .map(|run| {
            let random = &mut Random::new(run);
            let [mut tried, mut judged, mut there, mut leaks, mut doubles] = [0u64; 5];
            for _ in 0..RUN {
                let (edge, sides) = seams[random.below(seams.len() as u64) as usize];
                let [a, b] = edge.map(|v| mesh.vertices[v]);
                let o = centre + random.direction() * size * random.between(0.0, 3.0);
                let at = [0.0, 0.5, random.unit(), random.unit()][random.below(4) as usize];
                let faces = if at == 0.0 { &around[edge[0]][..] } else { &sides[..] };
                let d = a + (b - a) * at - o;
                let cosines = || faces.iter().map(|&k| normals[k].dot(d) / d.length());
                let one_way = cosines().all(|c| c > EDGE_ON) || cosines().all(|c| c < -EDGE_ON);
                if !one_way || (at == 0.0 && spokes[edge[0]] != faces.len()) {
                    continue;
                }
                tried += 1;
                let Some(hit) = subject.hit(o, d).filter(|h| h.t < 1.0 + 1e-6) else {
                    leaks += 1;
                    println!("{name}: leaks from {o:?} along {d:?}");
                    continue;
                };
                // Exact arithmetic takes its time: every so often.
                if !random.one_in(16) {
                    continue;
                }
                judged += 1;
                let met = faces.iter().filter_map(|&k| Some((k as u32, exact::to_triangle(&triangles[k], o, d)?)));
                let near: Vec<u32> = met.filter(|(_, t)| t.within_an_ulp(hit.t)).map(|(k, _)| k).collect();
                if let Some(&first) = near.iter().min() {
                    there += 1;
                    // A face of a lower number may share the point, never one of a higher.
                    if hit.order > first || (hit.order != first && near.contains(&hit.order)) {
                        doubles += 1;
                        println!("{name}: met twice from {o:?} along {d:?}: {near:?}, not {}", hit.order);
                    }
                }
            }
            [tried, judged, there, leaks, doubles]
        })
        .reduce(|| [0; 5], |a, b| [0, 1, 2, 3, 4].map(|k| a[k] + b[k]));
    println!(
        "{name}: {tried} rays through {} seams and their ends, of {} faces, {leaks} leaks; {judged} \
         of them judged exactly, {there} met there, {doubles} twice",
        seams.len(),
        mesh.faces.len()
    );
    assert!(tried > 0 && there > 0 && leaks == 0, "{name}: {leaks} of {tried} rays leak");
    assert_eq!(doubles, 0, "{name}: rays are met twice");
}

#[test]
fn case_19_scanned_mesh() {
    for name in ["dragon_vrip_res4.ply.gz", "dragon_vrip.ply.gz"] {
        match read_ply(&scans().join(name)) {
            Some(mesh) => crosses_every_seam(name, &mesh),
            None => println!("skipped: no {name} in {:?}", scans()),
        }
    }
}

#[test]
fn case_19_seams() {
    crosses_every_seam("knot", &knot(60, 12));
}
