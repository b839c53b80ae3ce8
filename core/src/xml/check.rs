//! A parsed tree against the declarations and the semantic checks.
//!
//! Every problem becomes a finding and reading goes on: a misspelt name is taken as
//! the one it resembles, an absent value as none, so that one mistake hides no other.

mod objects;

use std::ops::Range;

use glam::DVec3;
use roxmltree::{Attribute, Node};

use super::diagnostic::Code;
use super::finding::Finding;
use super::grammar::{self, Model, WIDEST};
use super::number::{self, NotANumber};
use super::part::Part;
use super::source::shown;
use super::suggest::closest;
use crate::scene::rules;

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
        if let Ok(share) = rules::share(value) {
            return Some(share);
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
