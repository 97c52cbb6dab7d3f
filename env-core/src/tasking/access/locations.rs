//! Locations on the ground, and the search for those that are near a satellite.
//!
//! Locations are ordered by bands of latitude, so that a search tests those of a few bands only: one scalar product for each, and
//! sixteen locations together.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::arc_search::ElevationExcess;
use crate::tasking::pack::Pack;
use crate::tasking::real::Real;
use crate::tasking::vector3::{Vector3, norm, scale};

/// Locations that are tested together.
const TOGETHER: usize = 16;
/// Bands of latitude, of equal area.
const BANDS: usize = 64;
/// Groups that are tested faster than latitudes are compared.
const FEW_GROUPS: usize = 4;
/// Margin of a search beyond its latitudes, as a sine, for rounding.
const MARGIN: f64 = 1e-9;

/// Unit vectors of [`TOGETHER`] locations by component; unused ones are NaN.
type Headings = [[f64; TOGETHER]; 3];

/// Locations on the ground.
#[derive(Debug, PartialEq)]
pub struct Locations {
    positions: Vec<Vector3<f64>>,
    /// Unit vectors of the locations.
    headings: Vec<Vector3<f64>>,
    bands: LatitudeBands,
    /// The least of the minimum elevations.
    min_elevation_rad: f64,
    /// Limits of each location, or one for all.
    limits: Vec<AccessLimit>,
    /// Distances of the locations from the Earth's centre, m.
    radii_m: Vec<f64>,
    /// Least distance of the locations from the Earth's centre, m.
    min_radius_m: f64,
}

/// Locations in the order of their bands.
#[derive(Debug, PartialEq)]
struct LatitudeBands {
    /// Number of locations in the bands before each one, and of all.
    starts: [usize; BANDS + 1],
    /// Index of each location.
    order: Vec<usize>,
    headings: Vec<Headings>,
}

/// Limits of the access of a location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccessLimit {
    min_elevation_rad: f64,
    /// Sine of the minimum elevation.
    sine: f64,
    max_range_m: f64,
}

impl AccessLimit {
    /// Creates limits of the elevation, rad, and of the range, m, which may be infinite.
    #[must_use]
    pub fn new(min_elevation_rad: f64, max_range_m: f64) -> Self {
        Self { min_elevation_rad, sine: libm::sin(min_elevation_rad), max_range_m }
    }
}

impl Locations {
    /// Creates locations at planet-fixed positions, m, with the same minimum elevation.
    #[must_use]
    pub fn new(positions: Vec<Vector3<f64>>, min_elevation_rad: f64) -> Self {
        Self::with_limits(positions, vec![AccessLimit::new(min_elevation_rad, f64::INFINITY)])
    }

    /// Creates locations at planet-fixed positions, m, with the limits of each, or with one for all.
    #[must_use]
    pub fn with_limits(positions: Vec<Vector3<f64>>, limits: Vec<AccessLimit>) -> Self {
        let radii_m: Vec<f64> = positions.iter().map(norm).collect();
        let min_radius_m = radii_m.iter().copied().fold(f64::INFINITY, f64::min);
        let heading = |(position, radius): (&Vector3<f64>, &f64)| position.map(|x| x / radius);
        let headings: Vec<Vector3<f64>> = positions.iter().zip(&radii_m).map(heading).collect();
        let bands = LatitudeBands::new(&headings);
        let elevations = limits.iter().map(|limit| limit.min_elevation_rad);
        let min_elevation_rad = elevations.fold(std::f64::consts::FRAC_PI_2, f64::min);
        Self { positions, headings, bands, min_elevation_rad, limits, radii_m, min_radius_m }
    }

    /// Number of the locations.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.positions.len()
    }

    /// True if there are no locations.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Planet-fixed position of a location, m.
    #[must_use]
    pub fn position(&self, location: usize) -> &Vector3<f64> {
        &self.positions[location]
    }

    /// Distances of the locations from the Earth's centre, m.
    pub(super) fn radii_m(&self) -> &[f64] {
        &self.radii_m
    }

    /// Sine of the minimum elevation of a location.
    pub(super) fn sine(&self, location: usize) -> f64 {
        self.limit(location).sine
    }

    /// Minimum elevation of the access of a location, rad.
    pub(super) fn elevation_rad(&self, location: usize) -> f64 {
        self.limit(location).min_elevation_rad
    }

    /// The least minimum elevation of access, rad.
    #[must_use]
    pub const fn min_elevation_rad(&self) -> f64 {
        self.min_elevation_rad
    }

    /// Limits of a location.
    fn limit(&self, location: usize) -> &AccessLimit {
        self.limits.get(location).unwrap_or(&self.limits[0])
    }

    /// Least distance of the locations from the Earth's centre, m.
    pub(super) const fn min_radius_m(&self) -> f64 {
        self.min_radius_m
    }

    /// Finds the locations whose central angle from a position has a cosine above `threshold`, in any order.
    pub(super) fn find_near(&self, position: &Vector3<f64>, threshold: f64, near: &mut Vec<usize>) {
        near.clear();
        let heading = scale(position, 1.0 / norm(position));
        let groups = self.bands.groups_near(heading[2], threshold);
        let first = groups.start * TOGETHER;
        let headings = &self.bands.headings[groups];
        let order = &self.bands.order[first.min(self.len())..];
        Arch::new().dispatch(NearLocations { headings, order, heading, threshold, near });
    }

    /// Excess of the elevation of a satellite at a position.
    pub(super) fn elevation_excess(&self, location: usize) -> ElevationExcess {
        let limit = self.limit(location);
        ElevationExcess {
            position: self.positions[location],
            heading: self.headings[location],
            sine: limit.sine,
            max_range_m: limit.max_range_m,
        }
    }
}

impl LatitudeBands {
    fn new(headings: &[Vector3<f64>]) -> Self {
        let mut starts = [0; BANDS + 1];
        for heading in headings {
            starts[band_of(heading[2]) + 1] += 1;
        }
        for band in 0..BANDS {
            starts[band + 1] += starts[band];
        }
        let mut order = vec![0; headings.len()];
        let mut grouped = vec![[[f64::NAN; TOGETHER]; 3]; headings.len().div_ceil(TOGETHER)];
        let mut next = starts;
        for (location, heading) in headings.iter().enumerate() {
            let next = &mut next[band_of(heading[2])];
            order[*next] = location;
            for (component, x) in grouped[*next / TOGETHER].iter_mut().zip(heading) {
                component[*next % TOGETHER] = *x;
            }
            *next += 1;
        }
        Self { starts, order, headings: grouped }
    }

    /// Groups with the locations near a latitude with this sine, by the cosine of the largest central angle.
    fn groups_near(&self, sine: f64, cosine: f64) -> Range<usize> {
        if self.headings.len() <= FEW_GROUPS {
            return 0..self.headings.len();
        }
        // Sines of the latitude less and plus the angle, unless they are beyond the poles.
        let across = ((1.0 - sine * sine) * (1.0 - cosine * cosine)).max(0.0).sqrt();
        let low = if -sine > cosine { -1.0 } else { sine * cosine - across };
        let high = if sine > cosine { 1.0 } else { sine * cosine + across };
        let first = self.starts[band_of(low - MARGIN)];
        let end = self.starts[band_of(high + MARGIN) + 1];
        first / TOGETHER..end.div_ceil(TOGETHER)
    }
}

/// Band of a sine of the latitude.
fn band_of(sine: f64) -> usize {
    ((0.5 * (sine + 1.0) * BANDS as f64) as usize).min(BANDS - 1)
}

/// Search for the headings whose scalar product with one exceeds a threshold.
struct NearLocations<'a> {
    headings: &'a [Headings],
    /// Indices of the locations of the headings.
    order: &'a [usize],
    heading: Vector3<f64>,
    threshold: f64,
    near: &'a mut Vec<usize>,
}

impl WithSimd for NearLocations<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F64_LANES {
            8 => self.find::<S, 2>(simd),
            4 => self.find::<S, 4>(simd),
            2 => self.find::<S, 8>(simd),
            _ => self.find::<S, 16>(simd),
        }
    }
}

impl NearLocations<'_> {
    /// Finds the locations with `N` registers for those that are tested together.
    #[inline(always)]
    fn find<S: Simd, const N: usize>(self, simd: S) {
        let [a, b, c] = self.heading.map(|x| Pack::<S, N>::splat(simd, x));
        let threshold = Pack::splat(simd, self.threshold);
        for (index, [x, y, z]) in self.headings.iter().enumerate() {
            let product = a * Pack::load(simd, x) + b * Pack::load(simd, y) + c * Pack::load(simd, z);
            if product.any(threshold.less_than(product)) {
                let mut products = [0.0; TOGETHER];
                product.store(&mut products);
                for (i, product) in products.iter().enumerate() {
                    if *product > self.threshold {
                        self.near.push(self.order[index * TOGETHER + i]);
                    }
                }
            }
        }
    }
}
