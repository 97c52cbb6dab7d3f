//! The map of a picture: coast, night at the start, stations, targets and the tracks of the satellites.

use env_core::tasking::setup::environment::DEFAULT_STATIONS;
use env_core::tasking::task::coastline::COASTLINE;
use env_core::tasking::task::forecast::{SatelliteForecast, TrackPoint};
use env_core::tasking::task::layout::TargetPlace;

use super::sky::LayoutSky;
use super::style::{
    BACKGROUND_TARGET_COLOUR, COAST_COLOUR, IMAGED_COLOUR, NIGHT_COLOUR, OUTAGE_COLOUR, STATION_COLOUR,
    SUN_COLOUR, TARGET_COLOUR, satellite_colour,
};
use crate::picture_parts::SPACE_COLOUR;
use crate::svg::{Arrow, DIM, GRID, Point, Stroke, SvgCanvas, TextAnchor, TextStyle};
use crate::tasking::field::field_centre;

/// Largest latitude of the map, degrees.
const TOP_DEG: f64 = 75.0;
/// Distance of the lines of the grid, degrees.
const GRID_DEG: i32 = 30;
/// Share of the Sun below which a track is drawn as in the shadow.
const DARK: f64 = 0.5;
/// Number of points of a track from the start to the head of its arrow.
const ARROW_POINTS: usize = 6;

/// Converts longitudes and latitudes to the page.
struct MapFrame {
    corner: Point,
    /// Units of the page per degree.
    scale: f64,
}

impl MapFrame {
    fn point(&self, (longitude, latitude): Point) -> Point {
        let x = self.corner.0 + (longitude + 180.0) * self.scale;
        (x, self.corner.1 + (TOP_DEG - latitude) * self.scale)
    }

    fn size(&self) -> Point {
        (360.0 * self.scale, 2.0 * TOP_DEG * self.scale)
    }

    /// Returns the parts of a line that do not cross the edge of the map.
    fn parts(&self, line: &[Point]) -> Vec<Vec<Point>> {
        let is_joined = |a: &Point, b: &Point| (a.0 - b.0).abs() < 180.0;
        line.chunk_by(is_joined).map(|part| part.iter().map(|place| self.point(*place)).collect()).collect()
    }
}

/// Draws the map. Returns its bottom.
pub(super) fn draw(canvas: &mut SvgCanvas, sky: &LayoutSky, corner: Point, width: f64) -> f64 {
    let frame = MapFrame { corner, scale: width / 360.0 };
    let size = frame.size();
    canvas.panel(corner, size, SPACE_COLOUR);
    canvas.begin_clip("map", corner, size);
    draw_grid(canvas, &frame);
    for line in COASTLINE.iter() {
        let points: Vec<Point> = line.iter().map(|place| frame.point(*place)).collect();
        canvas.line(&points, Stroke::new(COAST_COLOUR, 0.8));
    }
    draw_night(canvas, &frame, sky.forecast.sun);
    draw_targets(canvas, &frame, sky);
    draw_stations(canvas, &frame, sky);
    for (index, path) in sky.forecast.satellites.iter().enumerate().rev() {
        draw_track(canvas, &frame, path, index);
    }
    draw_field_numbers(canvas, &frame, sky);
    canvas.end_clip();
    corner.1 + size.1
}

fn draw_grid(canvas: &mut SvgCanvas, frame: &MapFrame) {
    let stroke = Stroke::new(GRID, 0.6).opacity(0.7);
    for degrees in (-180..=180).step_by(GRID_DEG as usize).map(f64::from) {
        canvas.line(&[frame.point((degrees, -TOP_DEG)), frame.point((degrees, TOP_DEG))], stroke);
        if degrees.abs() <= TOP_DEG {
            let (left, right) = (frame.point((-180.0, degrees)), frame.point((180.0, degrees)));
            canvas.line(&[left, right], stroke);
            let style = TextStyle::new(9.0).colour(DIM);
            canvas.text((left.0 + 3.0, left.1 - 2.0), style, &format!("{degrees:.0}°"));
        }
    }
}

/// Darkens the side of the Earth without sunlight at the start.
fn draw_night(canvas: &mut SvgCanvas, frame: &MapFrame, (sun_longitude, sun_latitude): Point) {
    // At an equinox the line between day and night would be vertical.
    let tangent = libm::tan(sun_latitude.to_radians());
    let tangent = if tangent.abs() < 1e-3 { 1e-3_f64.copysign(tangent) } else { tangent };
    let latitude = |longitude: i32| {
        let hour_angle = (f64::from(longitude) - sun_longitude).to_radians();
        (f64::from(longitude), libm::atan(-libm::cos(hour_angle) / tangent).to_degrees())
    };
    let pole = if tangent > 0.0 { -90.0 } else { 90.0 };
    let mut outline: Vec<Point> = (-180..=180).step_by(3).map(latitude).collect();
    outline.extend([(180.0, pole), (-180.0, pole)]);
    let points: Vec<Point> = outline.into_iter().map(|place| frame.point(place)).collect();
    canvas.area(&points, NIGHT_COLOUR, 0.45, None);
    let sun = frame.point((sun_longitude, sun_latitude));
    canvas.circle(sun, 5.0, SUN_COLOUR, Some(Stroke::new(SUN_COLOUR, 5.0).opacity(0.25)));
}

fn draw_targets(canvas: &mut SvgCanvas, frame: &MapFrame, sky: &LayoutSky) {
    let place = |target: &TargetPlace| frame.point((target.longitude_deg, target.latitude_deg));
    let (drawn, placed) = sky.forecast.targets.split_at(sky.forecast.drawn_targets);
    let dots: Vec<Point> = drawn.iter().map(place).collect();
    canvas.dots(&dots, Stroke::new(BACKGROUND_TARGET_COLOUR, 1.1).opacity(0.35));
    let is_imaged = |index: usize| sky.imaged.contains(&index);
    let imaged = drawn.iter().enumerate().filter(|(index, _)| is_imaged(*index));
    let dots: Vec<Point> = imaged.map(|(_, target)| place(target)).collect();
    canvas.dots(&dots, Stroke::new(IMAGED_COLOUR, 2.0).opacity(0.8));
    for (index, target) in placed.iter().enumerate() {
        let outline = is_imaged(sky.forecast.drawn_targets + index).then(|| Stroke::new(IMAGED_COLOUR, 1.0));
        canvas.circle(place(target), 0.9 + 2.1 * target.priority, TARGET_COLOUR, outline);
    }
}

fn draw_stations(canvas: &mut SvgCanvas, frame: &MapFrame, sky: &LayoutSky) {
    for station in &sky.forecast.stations {
        let at = frame.point((station.longitude, station.latitude));
        let reach = Stroke::new(STATION_COLOUR, 0.8).opacity(0.5).dashes("3 3");
        for part in frame.parts(&circle_of(station.longitude, station.latitude, station.radius)) {
            canvas.line(&part, reach);
        }
        draw_dish(canvas, at, STATION_COLOUR);
        canvas.text((at.0 + 6.0, at.1 + 3.0), TextStyle::new(10.0).colour(STATION_COLOUR), &station.name);
    }
    for station in sky.outages.iter().filter_map(|number| DEFAULT_STATIONS.get(*number)) {
        let [latitude, longitude] = station.degrees;
        let (x, y) = frame.point((longitude, latitude));
        draw_cross(canvas, (x, y));
        canvas.text((x + 7.0, y + 3.0), TextStyle::new(10.0).colour(OUTAGE_COLOUR), station.name);
    }
}

/// Draws the mark of a station in service.
pub(super) fn draw_dish(canvas: &mut SvgCanvas, (x, y): Point, colour: &'static str) {
    canvas.area(&[(x, y - 4.0), (x + 4.0, y + 3.0), (x - 4.0, y + 3.0)], colour, 1.0, None);
}

/// Draws the mark of a station that is out of service.
pub(super) fn draw_cross(canvas: &mut SvgCanvas, (x, y): Point) {
    for side in [-1.0, 1.0] {
        canvas.line(&[(x - 4.0, y - 4.0 * side), (x + 4.0, y + 4.0 * side)], Stroke::new(OUTAGE_COLOUR, 1.8));
    }
}

/// Points of a circle on the Earth, with a radius in degrees of arc.
fn circle_of(longitude: f64, latitude: f64, radius_deg: f64) -> Vec<Point> {
    let (sin_latitude, cos_latitude) = libm::sincos(latitude.to_radians());
    let (sin_radius, cos_radius) = libm::sincos(radius_deg.to_radians());
    let point = |step: i32| {
        let (sin, cos) = libm::sincos(f64::from(step * 10).to_radians());
        let sine = sin_latitude * cos_radius + cos_latitude * sin_radius * cos;
        let turn = libm::atan2(sin * sin_radius * cos_latitude, cos_radius - sin_latitude * sine);
        let longitude = (longitude + turn.to_degrees() + 540.0).rem_euclid(360.0) - 180.0;
        (longitude, libm::asin(sine.clamp(-1.0, 1.0)).to_degrees())
    };
    (0..=36).map(point).collect()
}

/// Draws the path of a satellite: solid in sunlight, dashed in the shadow, with an arrow at the start.
fn draw_track(canvas: &mut SvgCanvas, frame: &MapFrame, path: &SatelliteForecast, index: usize) {
    let colour = satellite_colour(index);
    let is_same = |a: &TrackPoint, b: &TrackPoint| (a.sunlight < DARK) == (b.sunlight < DARK);
    let mut last: Option<Point> = None;
    for part in path.track.chunk_by(is_same) {
        let stroke = if part[0].sunlight < DARK {
            Stroke::new(colour, 1.0).opacity(0.55).dashes("2 4")
        } else {
            Stroke::new(colour, 1.3).opacity(0.85)
        };
        let line: Vec<Point> = last.into_iter().chain(part.iter().map(TrackPoint::place)).collect();
        last = line.last().copied();
        for points in frame.parts(&line) {
            canvas.line(&points, stroke);
        }
    }
    let places: Vec<Point> = path.track.iter().take(ARROW_POINTS).map(TrackPoint::place).collect();
    let parts = frame.parts(&places);
    let (Some(first), Some(part)) = (places.first(), parts.first()) else { return };
    let start = frame.point(*first);
    if let Some(to) = part.last().filter(|_| part.len() > 1) {
        canvas.arrow(Arrow { from: start, to: *to }, 8.0, Stroke::new(colour, 2.4));
    }
    canvas.circle(start, 6.5, SPACE_COLOUR, Some(Stroke::new(colour, 2.0)));
    let style = TextStyle::new(9.0).colour(colour).anchor(TextAnchor::Middle).bold();
    canvas.text((start.0, start.1 + 3.2), style, &index.to_string());
}

/// Writes the numbers of the fields beside them.
fn draw_field_numbers(canvas: &mut SvgCanvas, frame: &MapFrame, sky: &LayoutSky) {
    let Some(design) = &sky.design else { return };
    for (index, field) in design.fields.iter().enumerate() {
        let satellite =
            usize::try_from(field.satellite).ok().and_then(|index| sky.forecast.satellites.get(index));
        let Some(place) = satellite.and_then(|path| field_centre(field, path)) else { continue };
        let at = frame.point((place.longitude_deg, place.latitude_deg));
        let radius = f64::from(field.spread_km) / 111.0 * frame.scale;
        let style = TextStyle::new(12.0).colour(TARGET_COLOUR).anchor(TextAnchor::Middle).bold();
        canvas.text((at.0, at.1 - radius - 5.0), style, &format!("#{index}"));
    }
}
