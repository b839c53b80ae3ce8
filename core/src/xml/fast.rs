//! The fast lane: world children in the shapes that programs write, read in one pass
//! without tree or allocation.
//!
//! It takes an object only if it is certain that the careful way would take it too,
//! with the same numbers and without a word; whatever is out of the ordinary, be it a
//! comment, an entity, another order of attributes, a warning or an error, it leaves
//! unread. So nothing here reports anything.

use glam::DVec3;

use super::lex::is_space;
use super::number;
use super::part::{Finish, Object, Paint, Part, Plane, Sphere, Triangle};
use crate::numeric::zero_area::surely_not_zero;
use crate::scene::{PlanePosition, rules};

/// A cursor over a document's bytes.
#[derive(Debug)]
pub(super) struct Fast<'t> {
    bytes: &'t [u8],
    at: usize,
    /// The last surface taken, as written, and its number: runs of equal ones are common.
    last_surface: (&'t [u8], u32),
}

/// An object that was read but not taken yet: its part knows nothing of it.
#[derive(Debug)]
pub(super) struct Seen<'t> {
    /// Its surface's number is set when it is taken.
    object: Object,
    surface: Coat<'t>,
    /// Where it ends.
    pub end: usize,
}

/// A surface that was read.
#[derive(Debug)]
enum Coat<'t> {
    /// A light has none.
    None,
    /// The same as that of the object before.
    Same,
    New {
        written: &'t [u8],
        finish: Finish,
        file: Option<(&'t str, usize)>,
    },
}

impl<'t> Fast<'t> {
    pub(super) fn new(bytes: &'t [u8]) -> Self {
        Self { bytes, at: 0, last_surface: (&[], 0) }
    }

    /// The object that begins at `at`, behind white space if any, and where it ends.
    #[inline]
    pub(super) fn object(&mut self, at: usize) -> Option<Seen<'t>> {
        self.at = at;
        self.space();
        let (object, surface) = match self.bytes.get(self.at + 1)? {
            b't' => self.triangle()?,
            b's' => self.sphere()?,
            b'p' => self.plane()?,
            b'l' => (self.light()?, Coat::None),
            _ => return None,
        };
        Some(Seen { object, surface, end: self.at })
    }

    /// Takes what [`Fast::object`] read last into `part`.
    #[inline]
    pub(super) fn take(&mut self, seen: Seen<'t>, part: &mut Part) {
        let Seen { mut object, surface, .. } = seen;
        let number = match surface {
            Coat::None => 0,
            Coat::Same => self.last_surface.1,
            Coat::New { written, mut finish, file } => {
                if let Some((name, at)) = file {
                    finish.paint = Paint::File(part.file(name, at..at + name.len()));
                }
                let number = part.surface(finish);
                if !written.is_empty() {
                    self.last_surface = (written, number);
                }
                number
            }
        };
        match &mut object {
            Object::Triangle(t) => t.surface = number,
            Object::Sphere(s) => s.surface = number,
            Object::Plane(p) => p.surface = number,
            Object::Light(_) => {}
        }
        part.push(object);
    }

    #[inline]
    fn rest(&self) -> &'t [u8] {
        &self.bytes[self.at..]
    }

    #[inline]
    fn space(&mut self) {
        while self.bytes.get(self.at).copied().is_some_and(is_space) {
            self.at += 1;
        }
    }

    #[inline]
    fn eat(&mut self, word: &[u8]) -> Option<()> {
        if self.rest().starts_with(word) {
            self.at += word.len();
            Some(())
        } else {
            None
        }
    }

    /// White space if any, then `>`.
    #[inline]
    fn tag_end(&mut self) -> Option<()> {
        self.space();
        self.eat(b">")
    }

    /// `<name>`, behind white space if any.
    #[inline]
    fn open(&mut self, tag: &[u8]) -> Option<()> {
        self.space();
        self.eat(tag)?;
        self.tag_end()
    }

    /// The end of an empty element whose start tag's attributes were read.
    #[inline]
    fn empty_end(&mut self, close: &[u8]) -> Option<()> {
        self.space();
        if self.eat(b"/>").is_some() {
            return Some(());
        }
        self.eat(b">")?;
        self.eat(close)?;
        self.tag_end()
    }

    /// White space, then `name="`; gives the quote.
    #[inline]
    fn attribute(&mut self, name: &[u8]) -> Option<u8> {
        if !is_space(*self.bytes.get(self.at)?) {
            return None;
        }
        self.space();
        self.eat(name)?;
        self.space();
        self.eat(b"=")?;
        self.space();
        let quote = *self.bytes.get(self.at)?;
        self.at += 1;
        matches!(quote, b'"' | b'\'').then_some(quote)
    }

    #[inline]
    fn number(&mut self, name: &[u8]) -> Option<f64> {
        let quote = self.attribute(name)?;
        let scanned = number::scan(self.rest())?;
        if self.bytes.get(self.at + scanned.len) != Some(&quote) {
            return None;
        }
        self.at += scanned.len + 1;
        (scanned.value.is_finite() && (scanned.value != 0.0 || !scanned.nonzero)).then_some(scanned.value)
    }

    #[inline]
    fn share(&mut self, name: &[u8]) -> Option<f64> {
        self.number(name).and_then(|v| rules::share(v).ok())
    }

    #[inline]
    fn vector(&mut self, open: &[u8], close: &[u8]) -> Option<DVec3> {
        self.open(open)?;
        self.space();
        self.eat(b"<vector")?;
        let (x, y, z) = (self.number(b"x")?, self.number(b"y")?, self.number(b"z")?);
        self.empty_end(b"</vector")?;
        self.open(close)?;
        Some(DVec3::new(x, y, z))
    }

    fn direction(&mut self, open: &[u8], close: &[u8]) -> Option<DVec3> {
        self.vector(open, close).filter(|v| *v != DVec3::ZERO)
    }

    fn color(&mut self) -> Option<[f64; 3]> {
        let color = [self.share(b"red")?, self.share(b"green")?, self.share(b"blue")?];
        self.empty_end(b"</color")?;
        Some(color)
    }

    /// Whether an element called `name` begins here, behind white space if any.
    #[inline]
    fn ahead(&mut self, tag: &[u8]) -> bool {
        self.space();
        self.rest()
            .strip_prefix(tag)
            .is_some_and(|r| r.first().is_some_and(|b| is_space(*b) || matches!(b, b'>' | b'/')))
    }

    #[inline]
    fn surface(&mut self) -> Option<Coat<'t>> {
        self.space();
        let (written, _) = self.last_surface;
        if !written.is_empty() && self.rest().starts_with(written) {
            self.at += written.len();
            return Some(Coat::Same);
        }
        self.new_surface()
    }

    fn new_surface(&mut self) -> Option<Coat<'t>> {
        let mut finish = Finish::default();
        let mut file = None;
        if !self.ahead(b"<surface") {
            return Some(Coat::New { written: &[], finish, file });
        }
        let start = self.at;
        self.open(b"<surface")?;
        if self.ahead(b"<finish") {
            self.eat(b"<finish")?;
            let here = self.at;
            finish.diffuse = self.share(b"diffuse").unwrap_or_else(|| {
                self.at = here;
                0.0
            });
            let one = self.at > here;
            let here = self.at;
            finish.reflect = self.share(b"reflect").unwrap_or_else(|| {
                self.at = here;
                0.0
            });
            if !(one || self.at > here) || finish.diffuse + finish.reflect > 1.0 {
                return None;
            }
            self.empty_end(b"</finish")?;
        }
        if self.ahead(b"<pigment") {
            self.open(b"<pigment")?;
            if self.ahead(b"<color") {
                self.eat(b"<color")?;
                finish.paint = Paint::Color(self.color()?);
            } else {
                self.open(b"<image")?;
                self.space();
                self.eat(b"<ppm")?;
                file = Some(self.file()?);
                self.empty_end(b"</ppm")?;
                self.open(b"</image")?;
            }
            self.open(b"</pigment")?;
        }
        self.open(b"</surface")?;
        Some(Coat::New { written: &self.bytes[start..self.at], finish, file })
    }

    fn file(&mut self) -> Option<(&'t str, usize)> {
        let quote = self.attribute(b"file")?;
        let len = memchr::memchr(quote, self.rest())?;
        let name = &self.rest()[..len];
        if name.is_empty() || !name.iter().all(|b| (b' '..=b'~').contains(b) && !matches!(b, b'<' | b'&')) {
            return None;
        }
        let at = self.at;
        self.at += len + 1;
        Some((std::str::from_utf8(name).ok()?, at))
    }

    fn triangle(&mut self) -> Option<(Object, Coat<'t>)> {
        self.open(b"<triangle")?;
        let c0 = self.vector(b"<c0", b"</c0")?;
        let by_sides = self.ahead(b"<v1");
        let (a, b) = if by_sides {
            (self.vector(b"<v1", b"</v1")?, self.vector(b"<v2", b"</v2")?)
        } else {
            (self.vector(b"<c1", b"</c1")?, self.vector(b"<c2", b"</c2")?)
        };
        let written = [c0, a, b];
        if !surely_not_zero(&written, by_sides) {
            return None;
        }
        let surface = self.surface()?;
        self.open(b"</triangle")?;
        Some((Object::Triangle(Triangle { written, surface: 0, by_sides }), surface))
    }

    fn sphere(&mut self) -> Option<(Object, Coat<'t>)> {
        self.eat(b"<sphere")?;
        let radius = self.number(b"radius").and_then(|r| rules::radius(r).ok())?;
        self.tag_end()?;
        let center = self.vector(b"<location", b"</location")?;
        let pole = if self.ahead(b"<pole") { Some(self.direction(b"<pole", b"</pole")?) } else { None };
        let equator = if self.ahead(b"<equator") { Some(self.direction(b"<equator", b"</equator")?) } else { None };
        let orientation = rules::orientation(pole, equator).ok()?;
        let surface = self.surface()?;
        self.open(b"</sphere")?;
        Some((Object::Sphere(Sphere { center, radius, orientation, surface: 0 }), surface))
    }

    fn plane(&mut self) -> Option<(Object, Coat<'t>)> {
        self.eat(b"<plane")?;
        let here = self.at;
        let distance = self.number(b"distance");
        if distance.is_none() {
            self.at = here;
        }
        self.tag_end()?;
        let normal = self.direction(b"<normal", b"</normal")?;
        let position = if self.ahead(b"<point") {
            let point = self.vector(b"<point", b"</point")?;
            if distance.is_some() {
                return None;
            }
            PlanePosition::Point(point)
        } else {
            PlanePosition::Distance(distance.unwrap_or(0.0))
        };
        let surface = self.surface()?;
        self.open(b"</plane")?;
        Some((Object::Plane(Plane { normal, position, surface: 0 }), surface))
    }

    fn light(&mut self) -> Option<Object> {
        self.open(b"<light")?;
        let position = self.vector(b"<position", b"</position")?;
        self.open(b"</light")?;
        Some(Object::Light(position))
    }
}
