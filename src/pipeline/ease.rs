//! The tape around bodies and garments: what is held in the refit, and what came of it.

use crate::measure::ease::{Worn, measured, ring};
use crate::measure::{Ease, Girth, Landmarks, Params, Side};
use crate::model::{Character, Garment, Outfit, Vec2, Vec3};
use crate::pattern::Holding;
use crate::proxy::Proxy;

/// Landmarks of every body of a fit.
pub(super) struct Tapes<'a> {
    sources: Vec<Landmarks>,
    /// The target in the pose of each source, where it is in another.
    unposed: Vec<Option<Landmarks>>,
    target: Landmarks,
    settings: &'a Params,
}

impl<'a> Tapes<'a> {
    pub(super) fn new(
        outfit: &Outfit,
        target: &Character,
        unposed: &[Option<Character>],
        settings: &'a Params,
    ) -> Self {
        let sources = outfit.bodies.iter().map(Landmarks::find).collect();
        let unposed = unposed.iter().map(|body| body.as_ref().map(Landmarks::find)).collect();
        Tapes { sources, unposed, target: Landmarks::find(target), settings }
    }

    /// The target as the refit sees it.
    fn fitted(&self, garment: &Garment) -> &Landmarks {
        self.unposed[garment.body].as_ref().unwrap_or(&self.target)
    }

    /// What the refit of a garment is to hold, if anything.
    pub(super) fn holding(&self, garment: &Garment) -> Option<Holding<'_>> {
        self.settings.holds(&garment.name).then(|| Holding {
            source: &self.sources[garment.body],
            target: self.fitted(garment),
            hold: &self.settings.hold,
        })
    }

    /// The ease of a garment, of its shell without details: on its source, carried, and draped.
    pub(super) fn measure(
        &self,
        proxy: &Proxy<'_>,
        carried: &[Vec3],
        draped: &[Vec3],
        pattern: &[Vec2],
    ) -> Ease {
        let garment = proxy.garment();
        let (draped, pattern) = (proxy.gather(draped), proxy.gather(pattern));
        let body = &self.sources[garment.body];
        let source = Worn { body, points: &garment.points, pattern: &garment.pattern };
        let refit = Worn { body: self.fitted(garment), points: carried, pattern: &pattern };
        let target = Worn { body: &self.target, points: &draped, pattern: &pattern };
        let held = |girth: Girth, side: Option<Side>| {
            let (on_source, on_target) = (body.get(girth, side)?, refit.body.get(girth, side)?);
            let holding = self.holding(garment)?;
            let ring = ring(garment, source.points, source.pattern, on_source)?;
            let source = measured(&ring, source.points, source.pattern, on_source.body_m);
            holding.hold.of(girth).wanted(on_target.body_m, &source)
        };
        Ease::new(garment, [source, refit, target], &held)
    }
}
