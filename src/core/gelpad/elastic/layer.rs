//! Response of a linear elastic layer bonded to a rigid shell: its Green's functions in the frequency domain.
//!
//! A layer of thickness h, Young's modulus 1 and Poisson ratio nu, loaded on its free surface by pressure p and traction
//! t, along (l) and across (t) the wave vector q: w = G p - i C t_l, u_l = i C p + H t_l, u_t = T t_t. The functions
//! follow from the plane-strain solution of a strip with a fixed base (as in Johnson 1985, section 5.8) and are written
//! with every growing exponential divided out, so that they hold for all q h. Displacements scale with 1 / E.

use crate::gelpad::material::Material;

/// The layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElasticLayer {
    /// Thickness h, mm.
    pub thickness_mm: f64,
    /// Poisson ratio nu, 0 to 0.4999: at 0.5 a layer without an edge cannot be pressed at all.
    pub poisson_ratio: f64,
}

impl ElasticLayer {
    /// That of a pad of this material.
    pub fn new(material: &Material) -> Self {
        Self { thickness_mm: material.thickness_mm, poisson_ratio: material.poisson_ratio }
    }

    /// G, mm: normal displacement under pressure of frequency `q` (rad/mm).
    pub fn normal(self, q: f64) -> f64 {
        let (nu, h) = (self.poisson_ratio, self.thickness_mm);
        if q * h < 1e-9 {
            return (1.0 + nu) * (1.0 - 2.0 * nu) * h / (1.0 - nu);
        }
        let Terms { kappa, mu, s, e, sinh, denominator } = Terms::new(self, q);
        // e (sinh 2s - 2s), from its series where the difference would cancel.
        let x = 2.0 * s;
        let excess = if x >= 1.2 {
            sinh - x * e
        } else {
            let series = [156.0, 110.0, 72.0, 42.0, 20.0].iter().fold(1.0, |sum, n| 1.0 + x * x / n * sum);
            e * x * x * x / 6.0 * series
        };
        (1.0 - nu) * 2.0 * ((kappa - 1.0) * sinh + excess) / (mu * q * denominator)
    }

    /// H, mm: displacement along q under traction along q.
    pub fn tangential(self, q: f64) -> f64 {
        if q * self.thickness_mm < 1e-9 {
            return self.thickness_mm * 2.0 * (1.0 + self.poisson_ratio);
        }
        let Terms { kappa, mu, s, e, sinh, denominator } = Terms::new(self, q);
        (1.0 - self.poisson_ratio) * 2.0 * (kappa * sinh + 2.0 * s * e) / (mu * q * denominator)
    }

    /// C, mm: displacement along q under pressure, a quarter period ahead of it.
    pub fn coupling(self, q: f64) -> f64 {
        if q * self.thickness_mm < 1e-9 {
            return 0.0;
        }
        let Terms { kappa, mu, s, e, denominator, .. } = Terms::new(self, q);
        let half_cosh = libm::expm1(-2.0 * s);
        (kappa * (kappa - 1.0) * half_cosh * half_cosh / 4.0 - 2.0 * s * s * e) / (mu * q * denominator)
    }

    /// T, mm: displacement across q under traction across q.
    pub fn transverse(self, q: f64) -> f64 {
        let mu = 0.5 / (1.0 + self.poisson_ratio);
        if q * self.thickness_mm < 1e-9 {
            return self.thickness_mm / mu;
        }
        libm::tanh(q * self.thickness_mm) / (mu * q)
    }

    /// G q for q h to infinity: a half-space's.
    pub fn half_space(self) -> f64 {
        2.0 * (1.0 - self.poisson_ratio * self.poisson_ratio)
    }

    /// The largest G over all q.
    pub fn softest(self) -> f64 {
        let step = 0.01 / self.thickness_mm;
        (0..2000).map(|k| self.normal(f64::from(k) * step)).fold(0.0, f64::max)
    }
}

/// What the functions share; everything that grows like exp(2 s) is multiplied by `e`.
struct Terms {
    kappa: f64,
    mu: f64,
    /// q h.
    s: f64,
    /// exp(-2 s).
    e: f64,
    /// e sinh 2s.
    sinh: f64,
    /// e D.
    denominator: f64,
}

impl Terms {
    fn new(layer: ElasticLayer, q: f64) -> Self {
        let kappa = 3.0 - 4.0 * layer.poisson_ratio;
        let s = q * layer.thickness_mm;
        let e = libm::exp(-2.0 * s);
        Self {
            kappa,
            mu: 0.5 / (1.0 + layer.poisson_ratio),
            s,
            e,
            sinh: -0.5 * libm::expm1(-4.0 * s),
            denominator: kappa * (1.0 + e * e) + e * (4.0 * s * s + 1.0 + kappa * kappa),
        }
    }
}
