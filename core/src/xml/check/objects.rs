//! What elements mean: the camera, lights, surfaces and objects.

use roxmltree::Node;

use super::{Checker, Eye, Fitted};
use crate::numeric::zero_area;
use crate::scene::{Invalid, Orientation, PlanePosition, rules};
use crate::xml::diagnostic::Code;
use crate::xml::grammar;
use crate::xml::part::{Finish, Object, Paint, Plane, Sphere, Triangle};
use crate::xml::source::shown;
use crate::xml::suggest::closest;

impl Checker<'_, '_> {
    pub(super) fn camera(&mut self, node: Node<'_, '_>) -> Option<Eye> {
        let [location, sky, look_at, _] = self.fit(node, "camera", &grammar::CAMERA).children;
        let location = self.vector(location, "location");
        let sky = self.direction(sky, "sky");
        let look_at = self.vector(look_at, "look_at");
        let ((location, _), (look_at, look_at_tag)) = (location?, look_at?);
        // Of a sky that is missing or zero, enough is said.
        let (up, sky_tag) = sky.clone().unwrap_or_default();
        match rules::view(location, up, look_at) {
            Err(Invalid::NoView) => self.find(Code::CameraView, look_at_tag, |f| {
                f.say("`look_at` equals `location`").expected("a point other than the camera's own place")
            }),
            Err(Invalid::SkyParallel) => self.find(Code::CameraSky, sky_tag, |f| {
                f.say("`sky` is parallel to the view direction")
                    .expected("a `sky` that points away from the line of sight")
            }),
            _ => return sky.map(|(sky, _)| Eye { location, sky, look_at }),
        }
        None
    }

    // -- objects -----------------------------------------------------------------

    pub(super) fn light(&mut self, node: Node<'_, '_>) -> Option<Object> {
        let position = self.fit(node, "light", &grammar::LIGHT).children[0];
        self.vector(position, "position").map(|(p, _)| Object::Light(p))
    }

    /// The part's number for a surface; the default one where there is none.
    fn surface(&mut self, node: Option<Node<'_, '_>>) -> Option<u32> {
        let mut finish = Finish::default();
        let mut whole = true;
        if let Some(node) = node {
            let [finish_node, pigment, ..] = self.fit(node, "surface", &grammar::SURFACE).children;
            if let Some(node) = finish_node {
                match self.finish(node) {
                    Some((diffuse, reflect)) => (finish.diffuse, finish.reflect) = (diffuse, reflect),
                    None => whole = false,
                }
            }
            if let Some(node) = pigment {
                match self.pigment(node) {
                    Some(paint) => finish.paint = paint,
                    None => whole = false,
                }
            }
        }
        whole.then(|| self.part.surface(finish))
    }

    fn finish(&mut self, node: Node<'_, '_>) -> Option<(f64, f64)> {
        let [diffuse, reflect, ..] = self.fit(node, "finish", &grammar::FINISH).attributes;
        if diffuse.is_none() && reflect.is_none() {
            self.find(Code::BlackFinish, self.tag(node), |f| {
                f.say("a `finish` with neither diffuse nor reflect makes a black surface")
                    .expected("diffuse=\"…\", reflect=\"…\" or both; without the element: diffuse 1")
            });
        }
        let diffuse = diffuse.map_or(Some(0.0), |a| self.share(a, "diffuse"));
        let reflect = reflect.map_or(Some(0.0), |a| self.share(a, "reflect"));
        let (diffuse, reflect) = (diffuse?, reflect?);
        if diffuse + reflect > 1.0 {
            self.find(Code::BrightFinish, self.tag(node), |f| {
                f.say(format!(
                    "diffuse + reflect is {}: the surface sends out more light than it takes in",
                    diffuse + reflect
                ))
                .expected("a sum of at most 1")
            });
        }
        Some((diffuse, reflect))
    }

    fn pigment(&mut self, node: Node<'_, '_>) -> Option<Paint> {
        let child = self.fit(node, "pigment", &grammar::PIGMENT).children[0]?;
        let name = child.tag_name().name();
        if name == "color" || closest(name, ["color", "image"]) == Some("color") {
            return self.color(child).map(Paint::Color);
        }
        let ppm = self.fit(child, "image", &grammar::IMAGE).children[0]?;
        let file = self.fit(ppm, "ppm", &grammar::PPM).attributes[0]?;
        let at = self.value_range(&file);
        if file.value().is_empty() {
            self.find(Code::Texture, at, |f| f.say("`file` is empty").expected("the name of a portable pixmap (.ppm)"));
            return None;
        }
        Some(Paint::File(self.part.file(file.value(), at)))
    }

    pub(super) fn triangle(&mut self, node: Node<'_, '_>) -> Option<Object> {
        let mut names = node.children().filter(Node::is_element).map(|n| n.tag_name().name());
        let by_sides = names.find_map(|n| match n {
            "c1" | "c2" => Some(false),
            "v1" | "v2" => Some(true),
            _ => None,
        });
        let by_sides = by_sides.unwrap_or(false);
        let (model, second, third) = if by_sides {
            (&grammar::TRIANGLE_BY_SIDES, "v1", "v2")
        } else {
            (&grammar::TRIANGLE_BY_CORNERS, "c1", "c2")
        };
        let [c0, a, b, surface] = self.fit(node, "triangle", model).children;
        let c0 = self.vector(c0, "c0");
        let a = self.vector(a, second);
        let b = self.vector(b, third);
        let surface = self.surface(surface);
        let written = [c0?.0, a?.0, b?.0];
        if zero_area::is_zero(&written, by_sides) {
            self.find(Code::DegenerateTriangle, self.tag(node), |f| {
                f.say("this triangle has no area and is never hit").expected("three corners that are not on one line")
            });
        }
        Some(Object::Triangle(Triangle { written, surface: surface?, by_sides }))
    }

    pub(super) fn plane(&mut self, node: Node<'_, '_>) -> Option<Object> {
        let Fitted { children: [normal, point, surface, _], attributes } = self.fit(node, "plane", &grammar::PLANE);
        let normal = self.direction(normal, "normal");
        if let (Some(_), Some(distance)) = (point, attributes[0]) {
            let at = self.range(&distance.range());
            self.find(Code::PlanePosition, at, |f| {
                f.say("this plane has both a `point` and a `distance`")
                    .expected("one of them, or neither for a plane through the origin")
            });
        }
        let distance = attributes[0].map_or(Some(0.0), |a| self.number(a, "distance"));
        let position = match point {
            Some(_) => self.vector(point, "point").map(|(p, _)| PlanePosition::Point(p)),
            None => distance.map(PlanePosition::Distance),
        };
        let surface = self.surface(surface);
        Some(Object::Plane(Plane { normal: normal?.0, position: position?, surface: surface? }))
    }

    pub(super) fn sphere(&mut self, node: Node<'_, '_>) -> Option<Object> {
        let Fitted { children: [location, pole, equator, surface], attributes } =
            self.fit(node, "sphere", &grammar::SPHERE);
        let radius = attributes[0].and_then(|a| {
            let value = self.number(a, "radius")?;
            if rules::radius(value).is_err() {
                let at = self.value_range(&a);
                self.find(Code::Radius, at, |f| {
                    f.say(format!("radius {} is not above 0", shown(a.value().trim()))).expected("a number above 0")
                });
                return None;
            }
            Some(value)
        });
        let center = self.vector(location, "location");
        let orientation = self.orientation(pole, equator);
        let surface = self.surface(surface);
        Some(Object::Sphere(Sphere {
            center: center?.0,
            radius: radius?,
            orientation: orientation?,
            surface: surface?,
        }))
    }

    /// `Some(None)` where nothing is written, `None` where what is written is wrong.
    #[expect(clippy::option_option, reason = "absent and wrong are different things here")]
    fn orientation(
        &mut self,
        pole: Option<Node<'_, '_>>,
        equator: Option<Node<'_, '_>>,
    ) -> Option<Option<Orientation>> {
        let (has_pole, has_equator) = (pole.is_some(), equator.is_some());
        let pole = self.direction(pole, "pole");
        let equator = self.direction(equator, "equator");
        if has_pole && pole.is_none() || has_equator && equator.is_none() {
            return None;
        }
        let tag = equator.clone().unwrap_or_default().1;
        let orientation = rules::orientation(pole.map(|(v, _)| v), equator.map(|(v, _)| v));
        if orientation.is_err() {
            self.find(Code::Orientation, tag, |f| {
                f.say("`pole` and `equator` are parallel").expected("an `equator` in another direction than `pole`")
            });
        }
        orientation.ok()
    }
}
