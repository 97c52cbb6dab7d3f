//! Bearing rose: bearings and relative speeds of the encounters that defeat an agent.

use env_core::critique::{BEARING_SECTORS, SpeedBands};
use maud::{Markup, html};

use store::failures::{EncounterBin, FailureCell};

const SIZE: f64 = 240.0;
/// Width reserved for a label on each side.
const LABEL_WIDTH: f64 = 64.0;
const INNER: f64 = 20.0;
const OUTER: f64 = 96.0;

/// Draws the rose of a failure mode; empty if the mode has no direction.
pub(super) fn rose(mode: &str, cells: &[FailureCell], bands: &SpeedBands) -> Markup {
    let met: Vec<(EncounterBin, i64)> = cells
        .iter()
        .filter(|cell| cell.key.mode == mode)
        .filter_map(|cell| Some((cell.key.encounter?, cell.counters.count)))
        .collect();
    let Some(highest) = met.iter().map(|(_, count)| *count).max() else { return html! {} };
    let rings = bands.edges.len() + 1;
    let title = format!("{}: failures by bearing and relative speed", mode.replace('_', " "));
    html! {
        figure {
            svg viewBox={ "0 0 " (SIZE + 2.0 * LABEL_WIDTH) " " (SIZE) } width=(SIZE + 2.0 * LABEL_WIDTH) height=(SIZE) role="img" aria-label=(title) {
                g transform={ "translate(" (SIZE / 2.0 + LABEL_WIDTH) " " (SIZE / 2.0) ")" } {
                    @for sector in 0..BEARING_SECTORS {
                        @for band in 0..rings {
                            @let count = count_of(&met, sector, band);
                            path d=(wedge(sector, band, rings)) fill=(shade(count, highest)) stroke="#d9dee6" {
                                title { (count) " failures, bearing " (sector * 30) "°, relative speed " (speed(band, bands)) }
                            }
                        }
                    }
                    text y=(-OUTER - 6.0) text-anchor="middle" { "radial out" }
                    text y=(OUTER + 16.0) text-anchor="middle" { "radial in" }
                    text x=(OUTER + 4.0) y="4" { "+ in-track" }
                    text x=(-OUTER - 4.0) y="4" text-anchor="end" { "− in-track" }
                }
            }
            figcaption {
                strong { (title) } ". Rings, from the centre: "
                @for band in 0..rings { @if band > 0 { "; " } (speed(band, bands)) }
                ". Colour: white is 0 failures, orange is " (highest) "."
            }
        }
    }
}

fn count_of(met: &[(EncounterBin, i64)], sector: u32, band: usize) -> i64 {
    let here = met.iter().find(|(bin, _)| bin.sector == sector && bin.band as usize == band);
    here.map_or(0, |(_, count)| *count)
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

/// Returns the SVG path of a sector in a ring. Radial out is up, in-track to the right.
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
