//! How three trajectories fare together.

use super::table::{Loss, Path, Table};
use crate::bracket::Flown;
use crate::chance::Seeded;
use crate::kessler::constants::{CONTACT_2, EARTH_RADIUS_2, FRAGMENTS, HORIZON, SATELLITES, SURVIVED};
use crate::kessler::flight::fragment;
use crate::kessler::kernel::{Body, distance_2, swept_2};
use crate::kessler::reward::{Fleet, Objective, score};
use crate::kessler::setup::{Contact, Physics, Setup};
use crate::seed::Seed;

/// How three trajectories fare together: fragments of those that are hit may hit the others. Exactly what the episode
/// gives, to the bit; a property test holds it to that.
pub(crate) fn judge(
    objective: Objective,
    setup: &Setup,
    seed: Seed,
    table: &Table,
    paths: [&Path; SATELLITES],
) -> Flown {
    told(objective, setup, paths, with_fragments(seed, table, paths))
}

/// How three trajectories fare together where each is lost as `loss` says.
pub(crate) fn told(
    objective: Objective,
    setup: &Setup,
    paths: [&Path; SATELLITES],
    loss: [Option<Loss>; SATELLITES],
) -> Flown {
    let alive = |i: usize, step: u32| loss[i].is_none_or(|l| step < l.step);
    let mut flown = Flown { score: 0.0, total: 0.0, steps: 0, lost: 0, goal: None, fuel_used: 0.0 };
    let mut goal = 0.0;
    for step in 1..=HORIZON {
        let t = step as usize;
        for (i, path) in paths.iter().enumerate() {
            // A burn precedes the motion: one that is lost in this step has still burnt.
            if alive(i, step - 1) && path.cost[t] > 0.0 {
                flown.fuel_used += path.cost[t];
            }
        }
        let fleet = Fleet {
            bodies: paths.map(|path| path.bodies[t]),
            fuel: paths.map(|path| path.fuel[t]),
            alive: std::array::from_fn(|i| if alive(i, step) { paths[i].survival[t] } else { 0.0 }),
        };
        let near = objective.goal(&fleet);
        if step > HORIZON - objective.goal_steps() {
            goal += near;
        }
        flown.total += objective.reward(&fleet, setup.fuel, near);
        flown.steps = step;
        if (0..SATELLITES).all(|i| !alive(i, step)) {
            break;
        }
    }
    let end = flown.steps as usize;
    flown.lost =
        (0..SATELLITES).filter(|&i| loss[i].is_some() || paths[i].survival[end] < SURVIVED).count() as u32;
    flown.score = score(flown.total);
    let steps = objective.goal_steps();
    flown.goal = (steps > 0).then(|| goal / f64::from(steps));
    flown
}

/// When and how each is destroyed, fragments of the others included.
pub(crate) fn with_fragments(
    seed: Seed,
    table: &Table,
    paths: [&Path; SATELLITES],
) -> [Option<Loss>; SATELLITES] {
    let mut loss = paths.map(|path| path.loss);
    if loss.iter().flatten().all(|l| !l.hit) {
        return loss;
    }
    let mut chance = Seeded::new(seed);
    let mut seen = [false; SATELLITES];
    loop {
        let next = (0..SATELLITES)
            .filter(|&i| !seen[i])
            .filter_map(|i| loss[i].filter(|l| l.hit).map(|l| (l.step, i)))
            .min();
        let Some((step, i)) = next else { return loss };
        seen[i] = true;
        for _ in 0..FRAGMENTS {
            let piece = fragment(paths[i].bodies[step as usize], &mut chance);
            fly_fragment(piece, step, i, table.physics, paths, &mut loss);
        }
    }
}

fn fly_fragment(
    mut piece: Body,
    from: u32,
    of: usize,
    physics: Physics,
    paths: [&Path; SATELLITES],
    loss: &mut [Option<Loss>; SATELLITES],
) {
    for step in from..=HORIZON {
        if step > from {
            if piece.radius_2() < EARTH_RADIUS_2 {
                if !physics.upstream {
                    return;
                }
            } else {
                piece = piece.coasted(physics.gravity);
            }
        }
        for (j, path) in paths.iter().enumerate() {
            // In the step of the collision only satellites later in order still look.
            let looks = j != of && (step > from || j > of) && loss[j].is_none_or(|l| step < l.step);
            let body = path.bodies[step as usize];
            let d2 = || {
                if physics.contact == Contact::Swept && step > from {
                    let (dx, dy) = (body.x - piece.x, body.y - piece.y);
                    swept_2(dx, dy, body.vx - piece.vx, body.vy - piece.vy)
                } else {
                    distance_2(body.x, body.y, piece.x, piece.y)
                }
            };
            if looks && d2() < CONTACT_2 {
                loss[j] = Some(Loss { step, hit: true });
            }
        }
    }
}
