//! Sequences on a curved gel: an object that slides, turns and rolls.

use super::CurvedGel;
use crate::base::chart::Chart;
use crate::base::gel::Site;
use crate::depth::chart_grid::ChartGrid;
use crate::depth::indenter::Indenter;
use crate::depth::texture::{PosedObject, Texture, TexturePlacement};
use crate::depth::{CaptureWindow, Depth};
use crate::gelpad::sliding::on_curved_gel::ObjectOnGel;
use crate::gelpad::sliding::{ObjectStep, Sliding};
use crate::mesh::clusters::Clusters;
use crate::pose::{PadPlane, Pose};

/// An object that moves over a curved gel.
pub struct MovingObject<'a> {
    /// The object; only its shape and, for the texture, its first pose count.
    pub indenter: &'a Indenter,
    /// The plane that the object is posed over.
    pub plane: &'a PadPlane,
    /// The object's micro-texture as it lay at the start.
    pub texture: Option<&'a Texture>,
    /// Thickness of the gel, mm.
    pub thickness_mm: f64,
}

impl CurvedGel {
    /// Advances an object through the steps of a frame. Poses are in the sensor's frame, motions in the plane that the
    /// object is posed over.
    ///
    /// # Panics
    ///
    /// Panics if the object is a height map.
    pub fn advance(&self, sliding: &mut Sliding, steps: &[ObjectStep], moving: &MovingObject<'_>) {
        sliding.begin_frame_on_gel();
        for step in steps {
            let (chart, site, deepest_mm) = self.find_contact_chart(moving.mesh(), &step.pose, moving.thickness_mm);
            let moved = sliding.follow_motion(&chart, site, moving.plane, step.motion);
            let texture = moving.placed_texture(sliding);
            let capture = |places: &ChartGrid<'_>, size: [usize; 2], window: CaptureWindow| {
                self.capture_on_chart(moving, texture.as_ref(), &step.pose, places, size, window)
            };
            let object = ObjectOnGel { chart: &chart, site, deepest_mm, capture: &capture };
            sliding.finish_step_on_gel(&object, step, moved);
        }
    }

    /// Computes the normal force of the object at a pose, N, without changing the state.
    pub fn force_n(&self, sliding: &Sliding, moving: &MovingObject<'_>, pose: &Pose) -> f64 {
        let (chart, site, deepest_mm) = self.find_contact_chart(moving.mesh(), pose, moving.thickness_mm);
        let texture = moving.placed_texture(sliding);
        let capture = |places: &ChartGrid<'_>, size: [usize; 2], window: CaptureWindow| {
            self.capture_on_chart(moving, texture.as_ref(), pose, places, size, window)
        };
        sliding.normal_force_on_gel_n(&ObjectOnGel { chart: &chart, site, deepest_mm, capture: &capture })
    }

    fn capture_on_chart(
        &self,
        moving: &MovingObject<'_>,
        texture: Option<&Texture>,
        pose: &Pose,
        places: &ChartGrid<'_>,
        size: [usize; 2],
        window: CaptureWindow,
    ) -> Depth {
        let mut depth = self.normals.capture_at(places, size, moving.mesh(), pose, window, moving.thickness_mm);
        if let Some(texture) = texture {
            crate::depth::texture::cut_along_normals(
                texture,
                &PosedObject { pose, plane: moving.plane },
                places,
                window.above_mm,
                &mut depth,
            );
        }
        depth
    }

    /// Returns the chart around the place where an object comes closest to the gel, that place, and how far the object
    /// reaches below the gel there, mm.
    fn find_contact_chart(&self, object: &Clusters, pose: &Pose, thickness_mm: f64) -> (Chart, Site, f64) {
        let (site, reaches_mm) = self.find_deepest_site(object, pose, thickness_mm);
        (self.chart_around(site), site, reaches_mm)
    }
}

impl MovingObject<'_> {
    fn mesh(&self) -> &Clusters {
        self.indenter.shape.clusters().expect("heights over a plane are not pressed into a curved gel")
    }

    fn placed_texture(&self, sliding: &Sliding) -> Option<Texture> {
        self.texture.map(|texture| {
            let initial =
                texture.placement.unwrap_or_else(|| TexturePlacement::at_pose_over(&self.indenter.pose, self.plane));
            texture.with_placement(sliding.texture_placement(initial))
        })
    }
}
