//! The light on a pressed skin: its reflection, its shadows on itself, and its average over pixels within which it bends.

use super::Curved;
use crate::core::base::chart::Chart;
use crate::core::base::grid::{Grid, Rect, bounding_box};
use crate::core::base::light::Light;
use crate::core::camera::gel_map::GelMap;
use crate::core::effects::{Effect, EffectLog, Requirement};
use crate::core::gelpad::Contact;
use crate::core::optics::background::BackgroundImage;
use crate::core::optics::coarse::Coarse;
use crate::core::optics::phong::Shadows;
use crate::core::optics::shadow::casting::Casting;
use crate::core::optics::skin::{PressedSkin, Skin};

/// How far, in nodes, slopes and what lies between nodes reach beyond what is displaced.
const BESIDE: usize = 2;

impl Curved {
    /// The light on a pressed skin, where it differs from that of the untouched one.
    pub(super) fn lit(
        &self,
        skin: &Skin,
        picture: &BackgroundImage,
        (contact, chart, map): (&Contact, &Chart, &GelMap),
        effects: &mut EffectLog,
    ) -> Light {
        let [width, height] = self.view.resolution_px;
        let displaced = contact.region.grown(BESIDE, width, height);
        let everywhere = effects.everywhere();
        let shadows = effects.timed(Effect::Shadows, || self.casting(skin, contact, chart, everywhere));
        // A shadow may be in view where the press is not.
        let in_view = !map.around(displaced).is_empty() || shadows.is_some();
        let need = |why| match (contact.region.is_empty(), in_view) {
            (true, _) => Requirement::Unneeded("the skin is untouched"),
            (false, false) => Requirement::Unneeded("the camera does not see what is pressed"),
            (false, true) => Requirement::Needed(why),
        };
        let shades = effects.enable(Effect::Shading, need("the skin is pressed in"));
        let shadows_needed = match skin.shadows() {
            Shadows::None => Requirement::Absent("the optics model has no shadows"),
            Shadows::Soft(_) if !contact.region.is_empty() && shadows.is_none() => {
                Requirement::Unneeded("no slope rises above an LED")
            }
            Shadows::Soft(_) => need("a slope rises above an LED"),
        };
        let shadows = if effects.enable(Effect::Shadows, shadows_needed) { shadows } else { None };
        let darkens = match skin.darkens() {
            true => need("the skin is pressed in"),
            false => Requirement::Absent("the optics model has no darkening"),
        };
        let darkens = effects.enable(Effect::Darkening, darkens);
        if !shades {
            effects.enable(Effect::Supersampling, need("the skin bends within pixels"));
            return Light::default();
        }
        let (there, shares, shadowed) = effects.timed(Effect::Shadows, || self.shares(shadows, displaced, everywhere));
        let wider = (!map.covers(shadowed)).then(|| GelMap::new(&self.gel, chart, displaced.united(shadowed)));
        let map = wider.as_ref().unwrap_or(map);
        let changed = match everywhere {
            true => Rect::whole(width, height),
            false => map.around(displaced.united(shadowed)),
        };
        let pressed = effects.timed(Effect::Shading, || map.pressed(&contact.surface, contact.region, changed));
        let within = if everywhere { changed } else { map.around(displaced) };
        let bent = effects
            .timed(Effect::Supersampling, || map.bent((&contact.surface, contact.region), (changed, within), &pressed));
        let need = match bent.is_empty() {
            true => Requirement::Unneeded("the skin bends little from pixel to pixel"),
            false => Requirement::Needed("the skin bends within pixels"),
        };
        let averages = effects.enable(Effect::Supersampling, need);
        let visible: Vec<Option<Vec<f32>>> = effects.timed(Effect::Shadows, || {
            let in_image = |shares: &Option<Grid<f32>>| Some(map.layer_of_part(shares.as_ref()?, there, changed, 1.0));
            shares.iter().map(in_image).collect()
        });
        let pressed = PressedSkin {
            region: changed,
            normals: pressed.normals.each_ref().map(|plane| &plane[..]),
            displaced_mm: &pressed.down_mm,
            visible: &visible,
            bent: if averages { &bent } else { &[] },
        };
        effects.timed(Effect::Shading, || skin.shade(&pressed, picture, darkens))
    }

    /// What casts shadows on a chart, if anything does. The gel itself, which bulges away from all light inside it, casts none.
    fn casting(&self, skin: &Skin, contact: &Contact, chart: &Chart, everywhere: bool) -> Option<Casting> {
        let Shadows::Soft(soft) = skin.shadows() else { return None };
        if contact.region.is_empty() && !everywhere {
            return None;
        }
        // What touches, and not what is displaced: that ends where the chart does, which goes on in steps.
        let touches = bounding_box(&contact.mask, |touches| touches > 0);
        let middle = [touches.x0 + touches.x1, touches.y0 + touches.y1].map(|ends| 0.5 * ends as f64);
        let rest = chart.rest(self.view.point_mm(middle));
        let lights = |pitch: [f64; 2], _| skin.casters(&rest, pitch);
        Casting::new(Coarse::new(soft.resolution), &contact.surface, &self.view, everywhere, lights)
    }

    /// The share of each LED that is seen from a part of the chart, that part, and the part of it that any shadow falls on.
    fn shares(
        &self,
        shadows: Option<Casting>,
        displaced: Rect,
        everywhere: bool,
    ) -> (Rect, Vec<Option<Grid<f32>>>, Rect) {
        let Some(shadows) = shadows else { return Default::default() };
        let [width, height] = self.view.resolution_px;
        let there = match everywhere {
            true => Rect::whole(width, height),
            false => shadows.reach(displaced, &self.view),
        };
        let mut line = Vec::new();
        let mut shadowed = Rect::default();
        let shares = shadows.shares(&self.view, there).into_iter().map(|values| {
            let values = values?;
            let mut shares = Grid { width: there.width(), height: there.height(), data: vec![1.0; there.area()] };
            for y in 0..there.height() {
                values.row(there.y0 + y, there.x0, &mut line, shares.row_mut(y));
            }
            let Rect { x0, y0, x1, y1 } = bounding_box(&shares, |share| share < 1.0);
            if x0 < x1 && y0 < y1 {
                let (x0, x1, y0, y1) = (x0 + there.x0, x1 + there.x0, y0 + there.y0, y1 + there.y0);
                shadowed = shadowed.united(Rect { x0, y0, x1, y1 });
            }
            Some(shares)
        });
        let shares = shares.collect();
        (there, shares, shadowed.grown(1, width, height))
    }
}
