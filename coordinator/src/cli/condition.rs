//! A scene's numerical condition, as `check` says it.

use std::fmt::Write;

use serde::Serialize;
use tessera_core::trace::Condition;

use super::describe::{number, of};

/// [`Condition`], as JSON has it.
#[derive(Debug, Serialize)]
pub(crate) struct ConditionJson {
    reach: f64,
    offset: f64,
    smallest: Option<f64>,
    largest: Option<f64>,
    slivers: usize,
    flat_triangles: usize,
    coinciding_triangles: usize,
    coinciding_spheres: usize,
    shared_planes: usize,
    objects_in_shared_planes: usize,
    planes_with_a_light: usize,
    planes_with_the_eye: usize,
    giants: usize,
    near_planes: usize,
    boxes: &'static str,
    outgrown: f64,
    packets: bool,
}

impl From<Condition> for ConditionJson {
    fn from(c: Condition) -> Self {
        Self {
            reach: c.reach,
            offset: c.offset,
            smallest: c.sizes.map(|s| s.0),
            largest: c.sizes.map(|s| s.1),
            slivers: c.slivers,
            flat_triangles: c.flat,
            coinciding_triangles: c.coinciding,
            coinciding_spheres: c.coinciding_spheres,
            shared_planes: c.shared.planes,
            objects_in_shared_planes: c.shared.objects,
            planes_with_a_light: c.shared.lit,
            planes_with_the_eye: c.shared.seen_edge_on,
            giants: c.giants,
            near_planes: c.near_planes,
            boxes: if c.single_boxes { "f32" } else { "f64" },
            outgrown: c.outgrown,
            packets: c.packets,
        }
    }
}

impl ConditionJson {
    /// The condition as people read it.
    pub(crate) fn to_text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{name:<12}{value}");
        };
        if let (Some(smallest), Some(largest)) = (self.smallest, self.largest) {
            line(
                "scale",
                format!(
                    "objects from {} to {} across, within {} of the camera, which is {} from the origin",
                    number(smallest),
                    number(largest),
                    number(self.reach),
                    number(self.offset)
                ),
            );
        }
        let odd = [
            (self.slivers, "triangle", "more than a million times longer than high: kept, decided exactly"),
            (self.flat_triangles, "triangle", "of exactly no area: never met, left out"),
            (self.coinciding_triangles, "triangle", "with the corners of an earlier one: left out"),
            (self.coinciding_spheres, "sphere", "equal to an earlier one: left out"),
            (
                self.objects_in_shared_planes,
                "object",
                "in one exact plane with others: the first in the document is seen",
            ),
            (self.planes_with_a_light, "exact plane", "with a light in it: unlit by it, and not in its way"),
            (self.planes_with_the_eye, "exact plane", "through the eye: not seen from there"),
            (self.giants, "object", "far larger than its distance from the eye: computed with relative to that"),
            (self.near_planes, "plane", "the same as an earlier one, or nearly: the first in the document is seen"),
        ];
        for (n, what, outcome) in odd {
            if n > 0 {
                line("numbers", format!("{} {outcome}", of(n as u64, what)));
            }
        }
        let share = number(100.0 * self.outgrown);
        let why = match (self.boxes, self.packets) {
            ("f32", true) => format!("f32 boxes enlarge {share} % of objects noticeably; packets of f32 rays go first"),
            ("f32", false) => "a plane or light is too far for f32, so every ray is traced in f64".into(),
            _ => format!("f32 boxes would enlarge {share} % of objects noticeably, so every ray is traced in f64"),
        };
        line("boxes", format!("{}: {why}", self.boxes));
        text
    }
}
