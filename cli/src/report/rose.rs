//! Rose of a failure mode: its failures by the angle of the world's sectors and, after encounters, by relative speed.

use env_core::critique::{PROFILE_SECTORS, SectorQuantity, SpeedBands};
use maud::{Markup, html};

use store::failures::FailureCell;

const SIZE: f64 = 240.0;
/// Width reserved for a label on each side.
const LABEL_WIDTH: f64 = 64.0;
const INNER: f64 = 20.0;
const OUTER: f64 = 96.0;

/// Cell of a rose with its number of failures.
struct RoseCell {
    sector: u32,
    /// Speed band; none without an encounter.
    band: Option<u32>,
    count: i64,
}

/// Draws the rose of a failure mode; empty if its failures have no angle.
pub(super) fn rose(
    mode: &str,
    cells: &[FailureCell],
    quantity: &SectorQuantity,
    bands: &SpeedBands,
) -> Markup {
    let with_angle = |cell: &FailureCell| {
        let count = cell.counters.count;
        cell.key.sector.map(|sector| RoseCell { sector, band: cell.key.band, count })
    };
    let cells: Vec<_> = cells.iter().filter(|cell| cell.key.mode == mode).filter_map(with_angle).collect();
    let Some(highest) = cells.iter().map(|cell| cell.count).max() else { return html! {} };
    let has_bands = cells.iter().any(|cell| cell.band.is_some());
    let rings = if has_bands { bands.edges.len() + 1 } else { 1 };
    let by =
        if has_bands { format!("{} and relative speed", quantity.name) } else { quantity.name.to_owned() };
    let title = format!("{}: failures by {by}", mode.replace('_', " "));
    let text = |count: i64, sector: u32, band: usize| {
        let text = format!("{count} failures, {} {}°", quantity.name, sector * 30);
        if has_bands { format!("{text}, relative speed {}", speed(band, bands)) } else { text }
    };
    let [up, right, down, left] = quantity.directions;
    html! {
        figure {
            svg viewBox={ "0 0 " (SIZE + 2.0 * LABEL_WIDTH) " " (SIZE) } width=(SIZE + 2.0 * LABEL_WIDTH) height=(SIZE) role="img" aria-label=(title) {
                g transform={ "translate(" (SIZE / 2.0 + LABEL_WIDTH) " " (SIZE / 2.0) ")" } {
                    @for sector in 0..PROFILE_SECTORS {
                        @for band in 0..rings {
                            @let count = count_of(&cells, sector, band);
                            path d=(wedge(sector, band, rings)) fill=(shade(count, highest)) stroke="#d9dee6" {
                                title { (text(count, sector, band)) }
                            }
                        }
                    }
                    text y=(-OUTER - 6.0) text-anchor="middle" { (up) }
                    text y=(OUTER + 16.0) text-anchor="middle" { (down) }
                    text x=(OUTER + 4.0) y="4" { (right) }
                    text x=(-OUTER - 4.0) y="4" text-anchor="end" { (left) }
                }
            }
            figcaption {
                strong { (title) } ". The " (quantity.name) " is the " (quantity.description) ". "
                @if has_bands {
                    "Rings, from the centre: "
                    @for band in 0..rings { @if band > 0 { "; " } (speed(band, bands)) }
                    ". "
                }
                "Colour: white is 0 failures, orange is " (highest) "."
            }
        }
    }
}

fn count_of(cells: &[RoseCell], sector: u32, band: usize) -> i64 {
    let is_here = |cell: &&RoseCell| cell.sector == sector && cell.band.unwrap_or(0) as usize == band;
    cells.iter().filter(is_here).map(|cell| cell.count).sum()
}

/// Returns a colour between white (0) and orange (`highest`).
fn shade(count: i64, highest: i64) -> String {
    let share = count as f64 / highest.max(1) as f64;
    let mix = |from: f64, to: f64| from + (to - from) * share;
    format!("rgb({:.0},{:.0},{:.0})", mix(246.0, 213.0), mix(247.0, 94.0), mix(249.0, 0.0))
}

fn speed(band: usize, bands: &SpeedBands) -> String {
    let from = band.checked_sub(1).and_then(|below| bands.edges.get(below)).copied().unwrap_or(0.0);
    match bands.edges.get(band) {
        Some(to) => format!("{from} to {to} {}", bands.unit),
        None => format!("{from} {} and more", bands.unit),
    }
}

/// Returns the SVG path of a sector in a ring. 0° is up, 90° to the right.
fn wedge(sector: u32, band: usize, rings: usize) -> String {
    let ring = (OUTER - INNER) / rings.max(1) as f64;
    let (near, far) = (INNER + ring * band as f64, INNER + ring * (band + 1) as f64);
    let degrees = f64::from(sector) * 30.0;
    let point = |degrees: f64, r: f64| {
        let (sin, cos) = libm::sincos(degrees.to_radians());
        format!("{:.2} {:.2}", r * sin, -r * cos)
    };
    let (a, b) = (degrees - 15.0, degrees + 15.0);
    format!(
        "M{}L{}A{far:.2} {far:.2} 0 0 1 {}L{}A{near:.2} {near:.2} 0 0 0 {}Z",
        point(a, near),
        point(a, far),
        point(b, far),
        point(b, near),
        point(a, near)
    )
}
