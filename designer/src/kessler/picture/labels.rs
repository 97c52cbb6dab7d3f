//! Room for words on a crowded map.

/// Where words may still go.
pub(super) struct Labels {
    corner: (f64, f64),
    size: (f64, f64),
    taken: Vec<Box2>,
}

/// A rectangle: left, top, right, bottom.
type Box2 = (f64, f64, f64, f64);

impl Labels {
    /// Labels within a window.
    pub(super) const fn within(corner: (f64, f64), size: (f64, f64)) -> Self {
        Self { corner, size, taken: Vec::new() }
    }

    /// Keeps a place free of labels.
    pub(super) fn avoid(&mut self, (x, y): (f64, f64), radius: f64) {
        self.taken.push((x - radius, y - radius, x + radius, y + radius));
    }

    /// The corner of a label for this place: near it, off what was placed before as far as that can be had.
    pub(super) fn place(&mut self, at: (f64, f64), size: (f64, f64)) -> (f64, f64) {
        let mut best = (f64::MAX, (at.0, at.1));
        for ring in 0..8 {
            let reach = 14.0 + 11.0 * f64::from(ring);
            for turn in 0..16 {
                let (sin, cos) = libm::sincos(f64::from(turn) * std::f64::consts::TAU / 16.0);
                // Beside it: the label's own middle is farther off the wider it is.
                let middle = (at.0 + cos * (reach + 0.5 * size.0), at.1 - sin * (reach + 0.2 * size.1));
                let corner = (middle.0 - 0.5 * size.0, middle.1 - 0.5 * size.1);
                let cost = self.overlap(corner, size) + 0.4 * reach;
                if cost < best.0 {
                    best = (cost, corner);
                }
            }
        }
        let (x, y) = best.1;
        self.taken.push((x, y, x + size.0, y + size.1));
        best.1
    }

    /// How much of a label would lie on others or outside, square pixels and more.
    fn overlap(&self, (x, y): (f64, f64), size: (f64, f64)) -> f64 {
        let (right, bottom) = (x + size.0, y + size.1);
        let shared = |other: &Box2| {
            let (w, h) = (right.min(other.2) - x.max(other.0), bottom.min(other.3) - y.max(other.1));
            if w > 0.0 && h > 0.0 { 40.0 + w * h } else { 0.0 }
        };
        let outside = (self.corner.0 - x).max(right - self.corner.0 - self.size.0).max(0.0)
            + (self.corner.1 - y).max(bottom - self.corner.1 - self.size.1).max(0.0);
        self.taken.iter().map(shared).sum::<f64>() + 1000.0 * outside
    }
}
