//! A sensor as the simulator knows it: numbers and images.

use std::sync::Arc;

use crate::base::gel::GelShape;
use crate::base::view::{MOST_PX, View};
use crate::camera::CameraParams;
use crate::camera::markers::{MarkerPattern, MarkerPrint};
use crate::camera::pins::Pins;
use crate::camera::projection::{LensModel, Projection};
use crate::depth::rest::{Grain, RestSurface};
use crate::gelpad::material::Material;
use crate::optics::background::{BackgroundImage, RenderedBackground};
use crate::optics::calibrated::Table;
use crate::optics::lamps::{self, Lamp};
use crate::optics::led::Led;
use crate::optics::residual::LightResidual;
use crate::optics::{Illumination, LightSource};

/// A camera-based tactile sensor.
///
/// Every field may be changed before [`Simulator::new`](crate::simulator::Simulator::new) checks all of them.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Sensor {
    /// Name written to labels.
    pub name: String,
    /// Width and height of the image, px, 1 to 8192.
    pub resolution_px: [usize; 2],
    /// Width and height of the pad's window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// The gelpad.
    pub gelpad: Material,
    /// Shape of a gel that a camera inside sees through [`Sensor::lens`]. `None`: it is flat, or nearly.
    pub shape: Option<GelShape>,
    /// The camera's lens and place, with such a gel.
    pub lens: LensModel,
    /// Pins inside such a gel.
    pub pins: Option<Pins>,
    /// Height of a pad that is nearly flat.
    pub rest_surface: Option<RestSurface>,
    /// Relief of the pad's coating.
    pub coating: Option<Grain>,
    /// The image without contact.
    pub background: Background,
    /// The LEDs, for the optics models `phong` and `led`.
    pub leds: Vec<Led>,
    /// The lamps, for the optics model `lamps`: none, or six.
    pub lamps: Vec<Lamp>,
    /// Share of the light lost where the pad is pressed down to the shell, 0 to 1; an optics model may say otherwise.
    pub darkening: f64,
    /// Light of the background image that is not the LEDs', 0 to 1 in each channel: what they add is scaled by the rest of
    /// that image. Without it nothing is scaled.
    pub stray_light: Option<[f64; 3]>,
    /// Light that the LEDs leave unexplained, for the same models.
    pub light_residual: Option<Arc<LightResidual>>,
    /// Calibrated optics, for the optics model `calibrated`.
    pub calibration: Option<Arc<Table>>,
    /// Dots printed on the pad.
    pub markers: Option<Markers>,
    /// The camera.
    pub camera: CameraParams,
}

/// The image without contact.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Background {
    /// Rendered from the LEDs; on a sensor with lamps, from these alone.
    Rendered(RenderedBackground),
    /// Taken by the camera itself, of the sensor's resolution.
    Photograph(Arc<BackgroundImage>),
}

impl Background {
    /// Size of the grain of one that is rendered, mm.
    pub(crate) fn grain_size_mm(&self) -> Option<f64> {
        match self {
            Self::Rendered(look) => Some(look.grain_size_mm),
            Self::Photograph(_) => None,
        }
    }
}

/// Dots printed on the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Markers {
    /// Their ink.
    pub print: MarkerPrint,
    /// The grid on which they are printed; `None` if it is said with each press.
    pub pattern: Option<MarkerPattern>,
}

/// Why a sensor cannot be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SensorError {
    /// The image has no pixel, or too many.
    #[error("resolution_px is {0:?}; allowed: 1 to {MOST_PX} on a side")]
    Resolution([usize; 2]),
    /// A number is out of range.
    #[error("{name} is {value}; it must be {allowed}")]
    Number {
        /// The field.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// It has some lamps, but not as many as the optics model `lamps` takes.
    #[error("the sensor has {0} lamps; a sensor has none or {count}", count = lamps::COUNT)]
    Lamps(usize),
    /// It has pins, and a flat gel.
    #[error("a sensor with pins needs the shape of its gel")]
    Pins,
    /// The camera looks past the gel.
    #[error("the camera sees no gel: move it, or turn it towards the gel")]
    NoGelInView,
    /// The photograph of the untouched pad has another size than the sensor's image.
    #[error("the background image has {found:?} px, the sensor {expected:?}")]
    BackgroundSize {
        /// Of the photograph.
        found: [usize; 2],
        /// Of the sensor.
        expected: [usize; 2],
    },
}

impl Sensor {
    /// A flat pad seen by an ideal camera: no LEDs, no markers, its background image rendered. `gelpad` is lit by what is added
    /// to [`Sensor::leds`].
    pub fn new(name: &str, resolution_px: [usize; 2], field_of_view_mm: [f64; 2], gelpad: Material) -> Self {
        Self {
            name: name.to_owned(),
            resolution_px,
            field_of_view_mm,
            gelpad,
            shape: None,
            lens: LensModel::default(),
            pins: None,
            rest_surface: None,
            coating: None,
            background: Background::Rendered(RenderedBackground::default()),
            leds: Vec::new(),
            lamps: Vec::new(),
            darkening: 0.0,
            stray_light: None,
            light_residual: None,
            calibration: None,
            markers: None,
            camera: CameraParams::default(),
        }
    }

    /// The same with an image of another size, of the same field of view.
    pub fn with_resolution(mut self, resolution_px: [usize; 2]) -> Self {
        self.resolution_px = resolution_px;
        self
    }

    /// Its view: the only place that knows where a pixel lies on the pad. Of a gel that is not flat, that of its chart.
    pub fn view(&self) -> View {
        if let Some(shape) = &self.shape
            && let Some(view) = self.projection().chart_view(shape)
        {
            return view;
        }
        let mm_per_px = std::array::from_fn(|k| self.field_of_view_mm[k] / self.resolution_px[k].max(1) as f64);
        View { resolution_px: self.resolution_px, mm_per_px }
    }

    /// Its camera, with a gel that is not flat.
    pub fn projection(&self) -> Projection {
        Projection::new(&self.lens, self.resolution_px, self.field_of_view_mm)
    }

    /// Width and height of what its view holds, mm.
    pub(crate) fn window_mm(&self) -> [f64; 2] {
        match &self.shape {
            None => self.field_of_view_mm,
            Some(_) => {
                let View { resolution_px, mm_per_px } = self.view();
                std::array::from_fn(|k| resolution_px[k] as f64 * mm_per_px[k])
            }
        }
    }

    /// The background image of its resolution.
    pub fn background(&self) -> Arc<BackgroundImage> {
        match &self.background {
            Background::Photograph(photograph) => Arc::clone(photograph),
            Background::Rendered(_) if !self.lamps.is_empty() => {
                Arc::new(lamps::Shader::new(&self.lamps, &self.view()).background())
            }
            Background::Rendered(look) => {
                Arc::new(BackgroundImage::rendered(look, &self.leds, self.field_of_view_mm, &self.view()))
            }
        }
    }

    /// Its light, beside the background image.
    pub(crate) fn illumination(&self) -> Illumination<'_> {
        Illumination {
            leds: &self.leds,
            lamps: &self.lamps,
            field_of_view_mm: self.field_of_view_mm,
            thickness_mm: self.gelpad.thickness_mm,
            photograph: self.has_photograph(),
            darkening: self.darkening,
            stray_light: self.stray_light,
            residual: self.light_residual.as_deref(),
        }
    }

    /// What is known of its light.
    pub fn light_source(&self) -> LightSource {
        LightSource::new(self.calibration.is_some(), &self.lamps)
    }

    /// True if the background image was taken by the camera itself.
    pub fn has_photograph(&self) -> bool {
        matches!(self.background, Background::Photograph(_))
    }

    /// The first thing about it that makes it impossible to simulate.
    pub fn check(&self) -> Result<(), SensorError> {
        if !self.resolution_px.iter().all(|px| (1..=MOST_PX).contains(px)) {
            return Err(SensorError::Resolution(self.resolution_px));
        }
        let positive = |name: &'static str, value: f64| match value > 0.0 && value.is_finite() {
            true => Ok(()),
            false => Err(SensorError::Number { name, value, allowed: "above 0 and finite" }),
        };
        positive("field_of_view_mm[0]", self.field_of_view_mm[0])?;
        positive("field_of_view_mm[1]", self.field_of_view_mm[1])?;
        positive("gelpad.thickness_mm", self.gelpad.thickness_mm)?;
        positive("gelpad.youngs_modulus_kpa", self.gelpad.youngs_modulus_kpa)?;
        let value = self.gelpad.poisson_ratio;
        if !(0.0..=0.4999).contains(&value) {
            return Err(SensorError::Number { name: "gelpad.poisson_ratio", value, allowed: "0 to 0.4999" });
        }
        match (&self.shape, &self.pins) {
            (None, Some(_)) => return Err(SensorError::Pins),
            (Some(shape), _) if self.projection().chart_view(shape).is_none() => {
                return Err(SensorError::NoGelInView);
            }
            _ => {}
        }
        if !self.lamps.is_empty() && self.lamps.len() != lamps::COUNT {
            return Err(SensorError::Lamps(self.lamps.len()));
        }
        let mut numbers = self.lamps.iter().flat_map(Lamp::numbers);
        if let Some((_, value)) = numbers.find(|(_, value)| !value.is_finite()) {
            return Err(SensorError::Number { name: "lamps", value, allowed: "finite" });
        }
        match &self.background {
            Background::Photograph(photograph) if [photograph.width, photograph.height] != self.resolution_px => {
                Err(SensorError::BackgroundSize {
                    found: [photograph.width, photograph.height],
                    expected: self.resolution_px,
                })
            }
            _ => Ok(()),
        }
    }
}
