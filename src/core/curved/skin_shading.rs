//! The light on a pressed skin: its reflection, the shadows it casts on itself, and its average over pixels in which it
//! bends.

use super::CurvedGel;
use crate::base::chart::Chart;
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::light::Light;
use crate::camera::gel_map::GelMap;
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::Contact;
use crate::optics::background::BackgroundImage;
use crate::optics::coarse::CoarseGrid;
use crate::optics::phong::Shadows;
use crate::optics::shadow::casting::ShadowCasting;
use crate::optics::skin::{PressedSkin, SkinShader};

/// Distance in nodes that slopes and interpolation reach beyond the displaced nodes.
const SLOPE_REACH: usize = 2;

/// Shadows of a press, on the nodes of its chart.
pub(super) struct CastShadows {
    /// For each LED, the part of the chart where its shadow falls and the visible share of the LED there; `None` if no
    /// shadow falls.
    visible_shares: Vec<Option<(Rect, Grid<f32>)>>,
    /// The part of the chart that any shadow falls on.
    pub part: Rect,
}

impl CurvedGel {
    /// Computes the light on a pressed skin, where it differs from that of the untouched one.
    pub(super) fn shade_skin(
        &self,
        skin: &SkinShader,
        picture: &BackgroundImage,
        (contact, map, shadows): (&Contact, &GelMap, Option<&CastShadows>),
        effects: &mut EffectLog,
    ) -> Light {
        let [width, height] = self.view.resolution_px;
        let displaced = contact.region.grown(SLOPE_REACH, width, height);
        let everywhere = effects.runs_everywhere();
        let part = displaced.union(shadows.map_or_else(Rect::default, |shadows| shadows.part));
        let changed = if everywhere { Rect::whole(width, height) } else { map.image_rect_of(part) };
        let need = |why| match (contact.region.is_empty(), changed.is_empty()) {
            (true, _) => Requirement::Unneeded("the skin is untouched"),
            (false, true) => Requirement::Unneeded("the camera does not see what is pressed"),
            (false, false) => Requirement::Needed(why),
        };
        let shades = effects.enable(Effect::Shading, need("the skin is pressed in"));
        for effect in [Effect::Mirror, Effect::Bounce] {
            effects.enable(effect, Requirement::Absent("it is computed on flat pads only"));
        }
        let darkens = match skin.darkens_with_depth() {
            true => need("the skin is pressed in"),
            false => Requirement::Absent("the optics model has no darkening"),
        };
        let darkens = effects.enable(Effect::Darkening, darkens);
        if !shades {
            effects.enable(Effect::Supersampling, need("the skin bends within pixels"));
            return Light::default();
        }
        let (skin_at, pressed) = effects.run_timed(Effect::Shading, || {
            let skin_at = map.skin_interpolator(&contact.surface, contact.region);
            let pressed = map.compute_pressed_part(&skin_at, changed);
            (skin_at, pressed)
        });
        let within = if everywhere { changed } else { map.image_rect_of(displaced) };
        let bent =
            effects.run_timed(Effect::Supersampling, || map.find_bent_pixels(&skin_at, (changed, within), &pressed));
        let need = match bent.is_empty() {
            true => Requirement::Unneeded("the skin bends little from pixel to pixel"),
            false => Requirement::Needed("the skin bends within pixels"),
        };
        let averages = effects.enable(Effect::Supersampling, need);
        let shares = shadows.map_or(&[][..], |shadows| &shadows.visible_shares);
        let visible: Vec<Option<Vec<f32>>> = effects.run_timed(Effect::Shadows, || {
            let in_image = |(there, shares): &(Rect, Grid<f32>)| map.warp_part(shares, *there, changed, 1.0);
            shares.iter().map(|shares| shares.as_ref().map(in_image)).collect()
        });
        let pressed = PressedSkin {
            region: changed,
            normals: pressed.normals.each_ref().map(|plane| &plane[..]),
            displacement_mm: &pressed.displacement_mm,
            visible_shares: &visible,
            bent: if averages { &bent } else { &[] },
        };
        effects.run_timed(Effect::Shading, || skin.shade(&pressed, picture, darkens))
    }

    /// Computes the shadows that a press casts on its chart; `None` if it casts none.
    pub(super) fn cast_shadows(
        &self,
        skin: &SkinShader,
        contact: &Contact,
        chart: &Chart,
        effects: &mut EffectLog,
    ) -> Option<CastShadows> {
        let everywhere = effects.runs_everywhere();
        let casting = effects.run_timed(Effect::Shadows, || self.find_shadow_casters(skin, contact, chart, everywhere));
        let need = match skin.shadows() {
            Shadows::None => Requirement::Absent("the optics model has no shadows"),
            Shadows::Soft(_) if contact.region.is_empty() => Requirement::Unneeded("the skin is untouched"),
            Shadows::Soft(_) if casting.is_none() => Requirement::Unneeded("no slope rises above an LED"),
            Shadows::Soft(_) => Requirement::Needed("a slope rises above an LED"),
        };
        let casting = if effects.enable(Effect::Shadows, need) { casting? } else { return None };
        Some(effects.run_timed(Effect::Shadows, || self.visible_shares(&casting, contact, everywhere)))
    }

    /// Finds what casts shadows on a chart; `None` if nothing does. The gel itself bulges away from all light inside it
    /// and casts none.
    fn find_shadow_casters(
        &self,
        skin: &SkinShader,
        contact: &Contact,
        chart: &Chart,
        everywhere: bool,
    ) -> Option<ShadowCasting> {
        let Shadows::Soft(soft) = skin.shadows() else { return None };
        if contact.region.is_empty() && !everywhere {
            return None;
        }
        // The contact, not the displaced nodes: those end where the chart does, and charts change in steps.
        let touches = bounding_box(&contact.mask, |touches| touches > 0);
        let middle = [touches.x0 + touches.x1, touches.y0 + touches.y1].map(|ends| 0.5 * ends as f64);
        let rest = chart.surface_frame(self.view.point_mm(middle));
        let lights = |mm_per_px: [f64; 2], _| skin.shadow_casters(&rest, mm_per_px);
        ShadowCasting::new(CoarseGrid::new(soft.resolution), &contact.surface, &self.view, everywhere, lights)
    }

    /// Computes the visible share of each LED where its shadow falls on the chart.
    fn visible_shares(&self, casting: &ShadowCasting, contact: &Contact, everywhere: bool) -> CastShadows {
        let [width, height] = self.view.resolution_px;
        let reach = match everywhere {
            true => Rect::whole(width, height),
            false => casting.shadowed_region(contact.region.grown(SLOPE_REACH, width, height), &self.view),
        };
        let mut line = Vec::new();
        let mut all = Grid { width: reach.width(), height: reach.height(), data: vec![1.0; reach.area()] };
        let mut part = Rect::default();
        let shares = casting.compute_visible_shares(&self.view, reach).into_iter().map(|values| {
            let values = values?;
            for y in 0..all.height {
                values.interpolate_row(reach.y0 + y, reach.x0, &mut line, all.row_mut(y));
            }
            // With a border in which everything is visible, so that interpolation to the unshadowed outside changes
            // nothing.
            let shadow = bounding_box(&all, |share| share < 1.0).grown(1, all.width, all.height);
            if shadow.is_empty() {
                return None;
            }
            let there = Rect {
                x0: shadow.x0 + reach.x0,
                y0: shadow.y0 + reach.y0,
                x1: shadow.x1 + reach.x0,
                y1: shadow.y1 + reach.y0,
            };
            part = part.union(there);
            Some((there, all.crop(shadow)))
        });
        CastShadows { visible_shares: shares.collect(), part }
    }
}
