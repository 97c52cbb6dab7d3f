//! Placement of labels on a crowded map.

use crate::svg::Point;

/// Number of rings around a point on which a label is tried.
const RINGS: u32 = 8;
/// Number of directions in which a label is tried on each ring.
const DIRECTIONS: u32 = 16;

/// Free space for labels in a rectangle of the page.
pub(crate) struct LabelPlacer {
    corner: Point,
    size: Point,
    taken: Vec<Rectangle>,
}

#[derive(Debug, Clone, Copy)]
struct Rectangle {
    left: f64,
    top: f64,
    right: f64,
    bottom: f64,
}

impl Rectangle {
    fn new((left, top): Point, size: Point) -> Self {
        Self { left, top, right: left + size.0, bottom: top + size.1 }
    }
}

impl LabelPlacer {
    /// Creates a placer for a rectangle without obstacles.
    pub(crate) const fn new(corner: Point, size: Point) -> Self {
        Self { corner, size, taken: Vec::new() }
    }

    /// Keeps the surroundings of a point free of labels.
    pub(crate) fn avoid(&mut self, (x, y): Point, radius: f64) {
        let (left, top, right, bottom) = (x - radius, y - radius, x + radius, y + radius);
        self.taken.push(Rectangle { left, top, right, bottom });
    }

    /// Places a label near a point, with as little overlap as possible. Returns its top left corner.
    pub(crate) fn place(&mut self, point: Point, size: Point) -> Point {
        let mut best = (f64::MAX, point);
        for ring in 0..RINGS {
            let radius = 14.0 + 11.0 * f64::from(ring);
            for turn in 0..DIRECTIONS {
                let angle = f64::from(turn) * std::f64::consts::TAU / f64::from(DIRECTIONS);
                let (sin, cos) = libm::sincos(angle);
                // The middle of a wide label must be farther away to the sides.
                let middle =
                    (point.0 + cos * (radius + 0.5 * size.0), point.1 - sin * (radius + 0.2 * size.1));
                let corner = (middle.0 - 0.5 * size.0, middle.1 - 0.5 * size.1);
                let cost = self.overlap(corner, size) + 0.4 * radius;
                if cost < best.0 {
                    best = (cost, corner);
                }
            }
        }
        self.taken.push(Rectangle::new(best.1, size));
        best.1
    }

    /// Returns the penalty of a label: the area that overlaps obstacles, and the length that is outside the rectangle.
    fn overlap(&self, corner: Point, size: Point) -> f64 {
        let label = Rectangle::new(corner, size);
        let shared = |other: &Rectangle| {
            let width = label.right.min(other.right) - label.left.max(other.left);
            let height = label.bottom.min(other.bottom) - label.top.max(other.top);
            if width > 0.0 && height > 0.0 { 40.0 + width * height } else { 0.0 }
        };
        let outside = (self.corner.0 - label.left).max(label.right - self.corner.0 - self.size.0).max(0.0)
            + (self.corner.1 - label.top).max(label.bottom - self.corner.1 - self.size.1).max(0.0);
        self.taken.iter().map(shared).sum::<f64>() + 1000.0 * outside
    }
}
