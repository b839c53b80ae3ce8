//! A parsed tree against the declarations and the semantic checks.
//!
//! Every problem becomes a finding and reading goes on: a misspelt name is taken as
//! the one it resembles, an absent value as none, so that one mistake hides no other.

use std::ops::Range;

use glam::DVec3;
use roxmltree::{Attribute, Node};

use super::diagnostic::Code;
use super::finding::Finding;
use super::grammar::{self, Model, WIDEST};
use super::number::{self, NotANumber};
use super::part::{Finish, Object, Paint, Part, Plane, Sphere, Triangle};
use super::source::shown;
use super::suggest::closest;
use crate::precise::predicates::{parallel, parallel_to_view};
use crate::precise::zero_area;
use crate::scene::{Orientation, PlanePosition};

/// From offsets in what the parser was given to offsets in the document: what lies
/// before `cut` is shifted by one amount, what lies behind by another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shift {
    pub cut: usize,
    pub before: isize,
    pub behind: isize,
}

impl Shift {
    pub(super) fn at(&self, offset: usize) -> usize {
        let by = if offset < self.cut { self.before } else { self.behind };
        offset.saturating_add_signed(by)
    }
}

/// The eye, as far as it was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Eye {
    pub location: DVec3,
    pub sky: DVec3,
    pub look_at: DVec3,
}

/// What stands around the world.
#[derive(Debug, Default)]
pub(super) struct Frame {
    pub camera: Option<Eye>,
    pub background: Option<[f64; 3]>,
    /// The world's start tag's name.
    pub world: Option<Range<usize>>,
}

/// Children and attributes of an element, by the places its model gives them.
struct Fitted<'a, 'd> {
    children: [Option<Node<'a, 'd>>; WIDEST],
    attributes: [Option<Attribute<'a, 'd>>; WIDEST],
}

/// Checks trees and collects what they hold.
pub(super) struct Checker<'p, 's> {
    /// What the parser was given.
    pub source: &'s str,
    pub shift: Shift,
    pub part: &'p mut Part,
}

impl Checker<'_, '_> {
    fn range(&self, range: &Range<usize>) -> Range<usize> {
        let start = self.shift.at(range.start);
        start..start + range.len()
    }

    /// An element's name in its start tag.
    fn tag(&self, node: Node<'_, '_>) -> Range<usize> {
        let start = node.range().start + 1;
        self.range(&(start..start + node.tag_name().name().len()))
    }

    fn find(&mut self, code: Code, at: Range<usize>, finding: impl FnOnce(Finding) -> Finding) {
        self.part.findings.push_with(code.severity(), || finding(Finding::new(code, at, "")));
    }

    // -- structure ---------------------------------------------------------------

    /// The document's root and all below it.
    pub(super) fn scene(&mut self, root: Node<'_, '_>) -> Frame {
        let name = root.tag_name().name();
        if name != "scene" {
            let code = if grammar::ELEMENTS.contains(&name) { Code::MisplacedElement } else { Code::UnknownElement };
            self.find(code, self.tag(root), |f| {
                f.say(format!("the root element is `{}`", shown(name)))
                    .expected("scene")
                    .suggest(closest(name, ["scene"]))
            });
        }
        let scene = self.fit(root, "scene", &grammar::SCENE);
        let [camera, background, world, _] = scene.children;
        Frame {
            camera: camera.and_then(|n| self.camera(n)),
            background: background.and_then(|n| {
                let fitted = self.fit(n, "background", &grammar::BACKGROUND);
                fitted.children[0].and_then(|n| self.color(n))
            }),
            world: world.map(|n| {
                self.world(n);
                self.tag(n)
            }),
        }
    }

    /// A world's children, each a light or an object.
    pub(super) fn world(&mut self, world: Node<'_, '_>) {
        self.attributes(world, "world", &[]);
        for child in world.children() {
            if !child.is_element() {
                self.no_text(child, "world", "plane, light, sphere and triangle elements");
                continue;
            }
            let name = child.tag_name().name();
            let meant = if grammar::OBJECTS.contains(&name) {
                Some(name)
            } else {
                let known = grammar::ELEMENTS.contains(&name);
                let near = if known { None } else { closest(name, grammar::OBJECTS) };
                self.find(misplaced(known), self.tag(child), |f| {
                    f.say(wrong_child(known, name, "world")).expected("plane, light, sphere or triangle").suggest(near)
                });
                near
            };
            let object = match meant {
                Some("triangle") => self.triangle(child),
                Some("sphere") => self.sphere(child),
                Some("plane") => self.plane(child),
                Some("light") => self.light(child),
                _ => None,
            };
            if let Some(object) = object {
                self.part.push(object);
            }
        }
    }

    /// Whether a node between elements is text that may not be there.
    fn no_text(&mut self, node: Node<'_, '_>, parent: &str, content: &str) {
        let Some(text) = node.text().filter(|_| node.is_text()) else { return };
        self.part.blank = true;
        let Some(first) = text.find(|c| !matches!(c, ' ' | '\t' | '\r' | '\n')) else { return };
        let range = node.range();
        let written = &self.source[range.clone()];
        // Where the text has references or sections, offsets in it are not those of the source.
        let start = if written.get(first..).is_some_and(|w| text.get(first..).is_some_and(|t| w.starts_with(t))) {
            range.start + first
        } else {
            range.start + written.find(|c: char| !c.is_ascii_whitespace()).unwrap_or(0)
        };
        let end = start + self.source[start..range.end].trim_end().len().min(40);
        let at = self.range(&(start..end.max(start + 1)));
        self.find(Code::UnexpectedContent, at, |f| {
            f.say(format!("`{parent}` may not hold text: `{}`", shown(text.trim()))).expected(content)
        });
    }

    fn attributes<'a, 'd>(
        &mut self,
        node: Node<'a, 'd>,
        element: &str,
        known: &'static [grammar::Attribute],
    ) -> [Option<Attribute<'a, 'd>>; WIDEST] {
        let mut found = [None; WIDEST];
        let mut strangers = Vec::new();
        for attribute in node.attributes() {
            match known.iter().position(|k| k.name == attribute.name() && attribute.namespace().is_none()) {
                Some(i) => found[i] = Some(attribute),
                None => strangers.push(attribute),
            }
        }
        for attribute in strangers {
            let free = known.iter().enumerate().filter(|(i, _)| found[*i].is_none()).map(|(_, k)| k.name);
            let near = closest(attribute.name(), free);
            let at = self.range(&attribute.range_qname());
            self.find(Code::UnknownAttribute, at, |f| {
                let names: Vec<_> = known.iter().map(|k| k.name).collect();
                let names = if names.is_empty() { "no attributes".into() } else { names.join(", ") };
                f.say(format!("`{element}` has no attribute `{}`", shown(attribute.name())))
                    .expected(names)
                    .suggest(near)
            });
            if let Some(i) = known.iter().position(|k| Some(k.name) == near) {
                found[i] = Some(attribute);
            }
        }
        for (i, attribute) in known.iter().enumerate().filter(|(_, k)| k.required) {
            if found[i].is_none() {
                self.find(Code::MissingAttribute, self.tag(node), |f| {
                    f.say(format!("`{element}` has no `{}`", attribute.name))
                        .expected(format!("{}=\"…\"", attribute.name))
                });
            }
        }
        found
    }

    fn fit<'a, 'd>(&mut self, node: Node<'a, 'd>, element: &str, model: &'static Model) -> Fitted<'a, 'd> {
        let attributes = self.attributes(node, element, model.attributes);
        let mut children: [Option<Node<'a, 'd>>; WIDEST] = [None; WIDEST];
        if model.slots.is_empty() {
            if let Some(child) = node.first_child() {
                let range = child.range();
                let at = self.range(&(range.start..range.start + range.len().min(1)));
                self.find(Code::UnexpectedContent, at, |f| {
                    f.say(format!("`{element}` must be empty")).expected(format!("<{element} …/>"))
                });
            }
            return Fitted { children, attributes };
        }
        // The last place filled, which a later child may not stand before.
        let mut last: Option<usize> = None;
        for child in node.children() {
            if !child.is_element() {
                self.no_text(child, element, model.content);
                continue;
            }
            let name = child.tag_name().name();
            let tag = self.tag(child);
            let Some(place) = model.slots.iter().position(|s| s.names.contains(&name)) else {
                let known = grammar::ELEMENTS.contains(&name);
                let free = model.slots.iter().enumerate().filter(|(i, _)| children[*i].is_none());
                let near = if known { None } else { closest(name, free.flat_map(|(_, s)| s.names.iter().copied())) };
                self.find(misplaced(known), tag, |f| {
                    f.say(wrong_child(known, name, element)).expected(model.content).suggest(near)
                });
                if let Some(place) = model.slots.iter().position(|s| near.is_some_and(|n| s.names.contains(&n))) {
                    children[place] = Some(child);
                    last = last.max(Some(place));
                }
                continue;
            };
            if let Some(other) = children[place] {
                let other = other.tag_name().name();
                self.find(Code::MisplacedElement, tag, |f| {
                    let message = if other == name {
                        format!("a second `{name}` in `{element}`")
                    } else {
                        format!("`{name}` beside `{other}` in `{element}`")
                    };
                    f.say(message).expected(model.content)
                });
                continue;
            }
            if last.is_some_and(|l| l > place) {
                self.find(Code::MisplacedElement, tag, |f| {
                    f.say(format!("`{name}` stands too late in `{element}`")).expected(model.content)
                });
            }
            last = last.max(Some(place));
            children[place] = Some(child);
        }
        for (place, slot) in model.slots.iter().enumerate() {
            if slot.required && children[place].is_none() {
                self.find(Code::MissingElement, self.tag(node), |f| {
                    f.say(format!("`{element}` has no `{}`", slot.names.join("` or `"))).expected(model.content)
                });
            }
        }
        Fitted { children, attributes }
    }

    // -- values ------------------------------------------------------------------

    fn value_range(&self, attribute: &Attribute<'_, '_>) -> Range<usize> {
        // The parser's own range of the value is wrong behind very long names or white space.
        let range = attribute.range();
        let written = &self.source[range.clone()];
        let quote = written.find(['"', '\'']).map_or(0, |i| i + 1);
        let start = range.start + quote;
        self.range(&(start..(range.end - 1).max(start)))
    }

    fn number(&mut self, attribute: Attribute<'_, '_>, name: &str) -> Option<f64> {
        let text = attribute.value();
        match number::parse(text) {
            Ok((value, underflow)) => {
                if underflow {
                    let at = self.value_range(&attribute);
                    self.find(Code::Underflow, at, |f| {
                        f.say(format!("`{}` is too small and becomes 0", shown(text)))
                            .expected("a magnitude of at least 5e-324, or 0")
                    });
                }
                Some(value)
            }
            Err(why) => {
                let at = self.value_range(&attribute);
                let code = if why == NotANumber::Overflow { Code::Overflow } else { Code::Number };
                self.find(code, at, |f| {
                    let (message, suggestion) = match why {
                        NotANumber::Empty => (format!("`{name}` is empty"), None),
                        NotANumber::NotFinite => (format!("`{}` is not a finite number", shown(text)), None),
                        NotANumber::Malformed(meant) => (format!("`{}` is not a number", shown(text)), meant),
                        NotANumber::Overflow => (format!("`{}` is too large a number", shown(text)), None),
                    };
                    let expected = if code == Code::Overflow {
                        "a magnitude of at most 1.7976931348623157e308"
                    } else {
                        "a decimal number such as -0.5, .5 or 1e-3"
                    };
                    f.say(message).expected(expected).suggest(suggestion)
                });
                None
            }
        }
    }

    /// A number in [0, 1].
    fn share(&mut self, attribute: Attribute<'_, '_>, name: &str) -> Option<f64> {
        let value = self.number(attribute, name)?;
        if (0.0..=1.0).contains(&value) {
            return Some(value + 0.0); // −0 as +0
        }
        let at = self.value_range(&attribute);
        self.find(Code::Range, at, |f| {
            f.say(format!("`{name}` is {}, outside [0, 1]", shown(attribute.value().trim())))
                .expected("a number from 0 to 1")
        });
        None
    }

    fn color(&mut self, node: Node<'_, '_>) -> Option<[f64; 3]> {
        let [red, green, blue, _] = self.fit(node, "color", &grammar::COLOR).attributes;
        let red = red.and_then(|a| self.share(a, "red"));
        let green = green.and_then(|a| self.share(a, "green"));
        let blue = blue.and_then(|a| self.share(a, "blue"));
        Some([red?, green?, blue?])
    }

    /// The vector in an element that holds one, and where it stands.
    fn vector(&mut self, holder: Option<Node<'_, '_>>, element: &str) -> Option<(DVec3, Range<usize>)> {
        let vector = self.fit(holder?, element, &grammar::VECTOR_HOLDER).children[0]?;
        let [x, y, z, _] = self.fit(vector, "vector", &grammar::VECTOR).attributes;
        let x = x.and_then(|a| self.number(a, "x"));
        let y = y.and_then(|a| self.number(a, "y"));
        let z = z.and_then(|a| self.number(a, "z"));
        Some((DVec3::new(x?, y?, z?), self.tag(vector)))
    }

    /// A vector that needs a direction.
    fn direction(&mut self, holder: Option<Node<'_, '_>>, element: &str) -> Option<(DVec3, Range<usize>)> {
        let (vector, at) = self.vector(holder, element)?;
        if vector != DVec3::ZERO {
            return Some((vector, at));
        }
        self.find(Code::ZeroVector, at, |f| {
            f.say(format!("`{element}` is zero and has no direction"))
                .expected("a vector that is not zero, of any length")
        });
        None
    }

    fn camera(&mut self, node: Node<'_, '_>) -> Option<Eye> {
        let [location, sky, look_at, _] = self.fit(node, "camera", &grammar::CAMERA).children;
        let location = self.vector(location, "location");
        let sky = self.direction(sky, "sky");
        let look_at = self.vector(look_at, "look_at");
        let ((location, _), (look_at, look_at_tag)) = (location?, look_at?);
        if location == look_at {
            self.find(Code::CameraView, look_at_tag, |f| {
                f.say("`look_at` equals `location`").expected("a point other than the camera's own place")
            });
            return None;
        }
        let (sky, sky_tag) = sky?;
        if parallel_to_view(location, look_at, sky) {
            self.find(Code::CameraSky, sky_tag, |f| {
                f.say("`sky` is parallel to the view direction")
                    .expected("a `sky` that points away from the line of sight")
            });
            return None;
        }
        Some(Eye { location, sky, look_at })
    }

    // -- objects -----------------------------------------------------------------

    fn light(&mut self, node: Node<'_, '_>) -> Option<Object> {
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

    fn triangle(&mut self, node: Node<'_, '_>) -> Option<Object> {
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

    fn plane(&mut self, node: Node<'_, '_>) -> Option<Object> {
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

    fn sphere(&mut self, node: Node<'_, '_>) -> Option<Object> {
        let Fitted { children: [location, pole, equator, surface], attributes } =
            self.fit(node, "sphere", &grammar::SPHERE);
        let radius = attributes[0].and_then(|a| {
            let value = self.number(a, "radius")?;
            if value > 0.0 {
                return Some(value);
            }
            let at = self.value_range(&a);
            self.find(Code::Radius, at, |f| {
                f.say(format!("radius {} is not above 0", shown(a.value().trim()))).expected("a number above 0")
            });
            None
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
        let (pole, equator) = match (has_pole, has_equator) {
            (false, false) => return Some(None),
            (true, false) => {
                let (pole, _) = pole?;
                (pole, orientation_default(pole, DVec3::X))
            }
            (false, true) => {
                let (equator, _) = equator?;
                (orientation_default(equator, DVec3::Y), equator)
            }
            (true, true) => {
                let ((pole, _), (equator, tag)) = (pole?, equator?);
                if parallel(pole, equator) {
                    self.find(Code::Orientation, tag, |f| {
                        f.say("`pole` and `equator` are parallel")
                            .expected("an `equator` in another direction than `pole`")
                    });
                    return None;
                }
                (pole, equator)
            }
        };
        Some(Some(Orientation { pole, equator }))
    }
}

/// What goes with a given pole or equator where the other is absent: `default`, or +z
/// where the two would be parallel.
pub(super) fn orientation_default(given: DVec3, default: DVec3) -> DVec3 {
    if parallel(given, default) { DVec3::Z } else { default }
}

fn misplaced(known: bool) -> Code {
    if known { Code::MisplacedElement } else { Code::UnknownElement }
}

fn wrong_child(known: bool, name: &str, parent: &str) -> String {
    if known {
        format!("`{name}` may not stand here in `{parent}`")
    } else {
        format!("unknown element `{}`", shown(name))
    }
}

impl Finding {
    fn say(mut self, message: impl Into<String>) -> Self {
        self.message = message.into();
        self
    }
}
