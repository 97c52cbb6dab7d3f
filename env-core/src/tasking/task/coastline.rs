//! The coastline that maps draw. `scripts/coastline` writes the data from Natural Earth (public domain).

use std::sync::LazyLock;

use crate::scene::Point;

const JSON: &str = include_str!("../data/coastline.json");

/// Lines of longitude and latitude, degrees.
pub static COASTLINE: LazyLock<Vec<Vec<Point>>> = LazyLock::new(|| {
    let lines: Vec<Vec<i32>> = serde_json::from_str(JSON).unwrap_or_default();
    let degrees = |tenths: &[i32; 2]| (f64::from(tenths[0]) / 10.0, f64::from(tenths[1]) / 10.0);
    let is_joined = |a: &Point, b: &Point| (a.0 - b.0).abs() <= 180.0;
    let points = |line: &Vec<i32>| line.as_chunks::<2>().0.iter().map(degrees).collect::<Vec<Point>>();
    // A line that crosses the edge of the map becomes two.
    lines
        .iter()
        .map(points)
        .flat_map(|line| line.chunk_by(is_joined).map(<[_]>::to_vec).collect::<Vec<_>>())
        .collect()
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coastline_is_on_the_map() {
        assert!(COASTLINE.len() > 100);
        let is_short = |line: &Vec<Point>| line.windows(2).all(|pair| (pair[0].0 - pair[1].0).abs() < 60.0);
        assert!(COASTLINE.iter().all(is_short), "no line crosses the map");
        for (longitude, latitude) in COASTLINE.iter().flatten() {
            assert!(longitude.abs() <= 180.0 && latitude.abs() <= 90.0);
        }
        // The northernmost point of Africa is near Tunis.
        let is_near = |point: &Point| (point.0 - 10.0).abs() < 1.5 && (point.1 - 37.3).abs() < 1.0;
        assert!(COASTLINE.iter().flatten().any(is_near));
    }
}
