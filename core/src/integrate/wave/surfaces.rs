//! Where rays meet what they are known to meet, and what is there.

use glam::DVec3;

use super::lanes::{Eight, Rays, SurfaceInteractions, eight_at_mut, load};
use super::paths::Paths;
use super::{Kinds, STEPS, Stage};
use crate::integrate::Refinement;
use crate::integrate::shade;
use crate::integrate::texels::TEXEL;
use crate::numeric::{Real, V3};
use crate::scene::{Pigment, TextureId};
use crate::shapes::{
    Decision, INSIDE, Listed, NONE, ObjectId, SHAPES, Shape, SurfaceInteraction, all_same, each_shape, firsts, texture,
};
use crate::simd::{F64x8, Simd, three};
use crate::traverse::PreparedScene;

impl Stage<'_> {
    /// Computes where rays meet what they are known to meet; what met nothing sees the background.
    #[inline(always)]
    pub(super) fn interactions<S: Simd>(
        &self,
        rays: &Rays,
        interactions: &mut SurfaceInteractions,
        kinds: &mut Kinds,
        paths: &mut Paths,
    ) {
        let PreparedScene { local, scene, .. } = &*self.tracer.prepared;
        interactions.reset(rays.count);
        let firsts = firsts(scene);
        kinds.counts = [0; SHAPES + 1];
        for i in 0..rays.count {
            let bare = interactions.met[i] & !INSIDE;
            let mut kind = usize::from(bare == NONE & !INSIDE);
            for first in &firsts[1..] {
                kind += usize::from(bare >= *first);
            }
            kinds.lists[kind][kinds.counts[kind]] = i as u32;
            kinds.counts[kind] += 1;
        }
        each_shape!(O => {
            let (list, count) = (&kinds.lists[O::KIND as usize], kinds.counts[O::KIND as usize]);
            for at in (0..count).step_by(8) {
                let at = Eight::of(list, at, count);
                let met = at.take(&interactions.met);
                let own = if O::HAS_INSIDE { at.take(&rays.own) } else { [NONE; 8] };
                let (mut ids, mut places, mut inner, mut same) = ([0; 8], [0; 8], [0.0; 8], [0.0; 8]);
                for k in 0..8 {
                    ids[k] = met[k] & !INSIDE;
                    places[k] = (ids[k] - firsts[O::KIND as usize]) as usize;
                    inner[k] = if met[k] & INSIDE != 0 { 1.0 } else { 0.0 };
                    same[k] = if own[k] != NONE && (met[k] ^ own[k]) & !INSIDE == 0 { 1.0 } else { 0.0 };
                }
                let (ray, objects) = (rays.pick::<S>(&at), O::eight::<S>(scene, local, &places));
                let interaction = O::interaction(&ray, &objects, S::F64x8::load(&inner), S::F64x8::load(&same));
                self.put::<S>(rays, interactions, &at, &ids, &interaction);
            }
        });
        for &i in &kinds.lists[SHAPES][..kinds.counts[SHAPES]] {
            let i = i as usize;
            paths.shine(rays.path[i] as usize, self.tracer.background * rays.throughput[i]);
        }
        self.refine::<S>(rays, interactions, paths);
    }

    /// Notes eight places on objects `ids`, and what the surfaces there are like.
    #[inline(always)]
    fn put<S: Simd>(
        &self,
        rays: &Rays,
        interactions: &mut SurfaceInteractions,
        at: &Eight,
        ids: &[u32; 8],
        interaction: &SurfaceInteraction<S::F64x8>,
    ) {
        at.store3(interaction.p, &mut interactions.p);
        at.store3(interaction.n, &mut interactions.n);
        at.store(interaction.ep, &mut interactions.ep);
        at.store(interaction.en, &mut interactions.en);
        let material = self.tracer.material(ObjectId(ids[0]));
        if all_same(ids) && matches!(material.pigment, Pigment::Color(_)) {
            at.store3(V3::<S::F64x8>::splat(material.albedo), &mut interactions.albedo);
            at.store(S::F64x8::splat(material.reflect), &mut interactions.reflect);
            return;
        }
        for k in 0..at.count() {
            let i = at.lane(k);
            let material = self.tracer.material(ObjectId(ids[k]));
            let mut albedo = material.albedo;
            if let Pigment::Texture(picture) = material.pigment {
                match self.pictured(rays, interactions, i, picture) {
                    Some(color) => albedo *= color,
                    // Too unsure of its place: not a number here, refined below.
                    None => interactions.en[i] = f64::INFINITY,
                }
            }
            for (to, x) in interactions.albedo.iter_mut().zip(albedo.to_array()) {
                to[i] = x;
            }
            interactions.reflect[i] = material.reflect;
        }
    }

    /// Finds the places that f64 does not know well enough, and takes them from wide arithmetic.
    #[inline(always)]
    fn refine<S: Simd>(&self, rays: &Rays, interactions: &mut SurfaceInteractions, paths: &mut Paths) {
        for at in (0..rays.count).step_by(8) {
            let interaction = interactions.eight::<S>(at);
            let mut nearest = S::F64x8::splat(self.tracer.prepared.local.nearest_light_at_first());
            for &light in &self.tracer.prepared.local.lights {
                nearest = shade::nearer(nearest, &interaction, V3::splat(light));
            }
            let excess = shade::excess(&interaction, nearest, load::<S>(&rays.throughput, at));
            let fine = excess.le(S::F64x8::splat(0.0));
            if fine != 0xff {
                for lane in 0..8.min(rays.count - at) {
                    if fine >> lane & 1 == 0 {
                        paths.refine(rays, interactions, at + lane);
                    }
                }
            }
        }
    }

    /// The picture's colour where ray `i` met it, `None` where f64 does not place it well enough.
    #[inline(never)]
    fn pictured(&self, rays: &Rays, interactions: &SurfaceInteractions, i: usize, picture: TextureId) -> Option<DVec3> {
        let tracer = self.tracer;
        let scene = &*tracer.prepared.scene;
        let met = Decision::of(interactions.met[i])?;
        let (interaction, ray) = (interactions.one(i), rays.one(i));
        let at = texture::Place { met, interaction: &interaction, ray: &ray };
        let (uv, e) = texture::coordinates(scene, &tracer.prepared.local, &tracer.mappings, &at);
        let data = &scene.textures()[picture.0 as usize];
        let size = f64::from(data.width().max(data.height()));
        let fine = e * size <= TEXEL || tracer.refinement == Refinement::Off;
        fine.then(|| tracer.picture_color(picture, uv, met.id))
    }

    /// The mirrored rays of all places that mirror.
    #[inline(always)]
    pub(super) fn reflect<S: Simd>(
        &self,
        rays: &Rays,
        interactions: &SurfaceInteractions,
        next: &mut Rays,
        paths: &mut Paths,
    ) {
        next.count = 0;
        if paths.step < STEPS as usize && paths.trails.len() <= paths.step {
            paths.trails.push(super::lanes::column(NONE));
        }
        for at in (0..rays.count).step_by(8) {
            let throughput = load::<S>(&rays.throughput, at) * load::<S>(&interactions.reflect, at);
            let count = 8.min(rays.count - at);
            let goes_on = (throughput - S::F64x8::splat(paths.least)).positive() & (0xff >> (8 - count));
            if goes_on == 0 {
                continue;
            }
            let mirrored = shade::reflect(&rays.eight::<S>(at), &interactions.eight::<S>(at));
            let (mut d, mut ed) = (mirrored.d, mirrored.ed);
            if self.tracer.refinement == Refinement::Off || interactions.any_refined(at) {
                let mut lanes = [[0.0; 8]; 4];
                d.x.store(&mut lanes[0]);
                d.y.store(&mut lanes[1]);
                d.z.store(&mut lanes[2]);
                ed.store(&mut lanes[3]);
                for lane in 0..count {
                    paths.mirrored(interactions, at + lane, lane, &mut lanes);
                }
                (d, ed) = (three::<S>(&lanes, 0), S::F64x8::load(&lanes[3]));
            }
            // The directions of rays that are given have no errors. Their starts keep theirs: within them lies the plane
            // that a ray starts in, and what lies in it is not met.
            let shows = throughput - S::F64x8::splat(self.tracer.given);
            let ed = shows.if_positive(ed, S::F64x8::splat(0.0));
            let to = next.count;
            let o = super::lanes::load3::<S>(&interactions.p, at);
            for (v, x) in next.o.iter_mut().zip([o.x, o.y, o.z]) {
                x.compress(goes_on).store(eight_at_mut(v, to));
            }
            for (v, x) in next.d.iter_mut().zip([d.x, d.y, d.z]) {
                x.compress(goes_on).store(eight_at_mut(v, to));
            }
            load::<S>(&interactions.ep, at).compress(goes_on).store(eight_at_mut(&mut next.eo, to));
            ed.compress(goes_on).store(eight_at_mut(&mut next.ed, to));
            throughput.compress(goes_on).store(eight_at_mut(&mut next.throughput, to));
            *eight_at_mut(&mut next.own, to) = S::compress(super::lanes::eight_at(&interactions.met, at), goes_on);
            *eight_at_mut(&mut next.path, to) = S::compress(super::lanes::eight_at(&rays.path, at), goes_on);
            let more = goes_on.count_ones() as usize;
            for k in to..to + more {
                paths.note(next.path[k], next.own[k]);
            }
            next.count += more;
        }
        paths.counts.mirror += next.count as u64;
    }
}
