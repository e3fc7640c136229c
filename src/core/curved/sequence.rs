//! An object that slides, turns and rolls on a gel that is not flat.

use super::Curved;
use crate::base::chart::Chart;
use crate::base::gel::Site;
use crate::depth::indenter::Indenter;
use crate::depth::places::Places;
use crate::depth::texture::{Posed, Texture, TexturePlacement};
use crate::depth::{Depth, Window};
use crate::gelpad::sliding::over_gel::OverGel;
use crate::gelpad::sliding::{ObjectStep, Sliding};
use crate::mesh::clusters::Clusters;
use crate::pose::{PadPlane, Pose};

/// An object that moves over a gel.
pub struct MovingObject<'a> {
    /// Of which only the shape counts.
    pub indenter: &'a Indenter,
    /// The plane that it is posed over.
    pub plane: &'a PadPlane,
    /// Its micro-texture as it lay at the start.
    pub texture: Option<&'a Texture>,
    /// Thickness of the gel, mm.
    pub thickness_mm: f64,
}

impl Curved {
    /// Takes an object through the steps of a frame: poses are in the sensor's frame, motions in the plane that it is posed over.
    ///
    /// # Panics
    ///
    /// If what is pressed is a height map.
    pub fn advance(&self, sliding: &mut Sliding, steps: &[ObjectStep], moving: &MovingObject<'_>) {
        sliding.begin_over_gel();
        for step in steps {
            let (chart, site, deepest_mm) = self.under(moving.mesh(), &step.pose, moving.thickness_mm);
            let moved = sliding.come_over(&chart, site, moving.plane, step.motion);
            let texture = moving.carried_texture(sliding);
            let capture = |places: &Places<'_>, size: [usize; 2], window: Window| {
                self.captured(moving, texture.as_ref(), &step.pose, places, size, window)
            };
            let object = OverGel { chart: &chart, site, deepest_mm, capture: &capture };
            sliding.press_over(&object, step, moved);
        }
    }

    /// Force of the object if it were pressed in at a pose, N.
    pub fn force_n(&self, sliding: &Sliding, moving: &MovingObject<'_>, pose: &Pose) -> f64 {
        let (chart, site, deepest_mm) = self.under(moving.mesh(), pose, moving.thickness_mm);
        let texture = moving.carried_texture(sliding);
        let capture = |places: &Places<'_>, size: [usize; 2], window: Window| {
            self.captured(moving, texture.as_ref(), pose, places, size, window)
        };
        sliding.force_over_n(&OverGel { chart: &chart, site, deepest_mm, capture: &capture })
    }

    fn captured(
        &self,
        moving: &MovingObject<'_>,
        texture: Option<&Texture>,
        pose: &Pose,
        places: &Places<'_>,
        size: [usize; 2],
        window: Window,
    ) -> Depth {
        let mut depth = self.nodes.capture_at(places, size, moving.mesh(), pose, window, moving.thickness_mm);
        if let Some(texture) = texture {
            crate::depth::texture::cut_along_normals(
                texture,
                &Posed { pose, plane: moving.plane },
                places,
                window.above_mm,
                &mut depth,
            );
        }
        depth
    }

    /// The chart around the place where an object comes closest to the gel, that place, and how far it reaches below the gel, mm.
    fn under(&self, object: &Clusters, pose: &Pose, thickness_mm: f64) -> (Chart, Site, f64) {
        let (site, reaches_mm) = self.deepest(object, pose, thickness_mm);
        (self.chart(site), site, reaches_mm)
    }
}

impl MovingObject<'_> {
    fn mesh(&self) -> &Clusters {
        self.indenter.shape.clusters().expect("heights over a plane are not pressed into a curved gel")
    }

    fn carried_texture(&self, sliding: &Sliding) -> Option<Texture> {
        self.texture.map(|texture| {
            let laid = texture.laid.unwrap_or_else(|| TexturePlacement::over(&self.indenter.pose, self.plane));
            texture.laid_out(sliding.carried(laid))
        })
    }
}
