//! Actions along each satellite's own axes: the executed actions that a batch reports have the same effect
//! along the world's axes, to the bit, and point in the right direction.

use std::sync::Arc;

use crate::batch::{Autoreset, Batch, BatchBuffers, BatchConfig, BatchOutput, ObservationMode, SeedSequence};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::KESSLER_TASKS;
use crate::scene::{Primitive, Style};
use crate::seed::Seed;
use crate::space::Axes;
use crate::task::Recipe;
use crate::task::TaskSpec;

/// Number of environments of a batch.
const AXES_ENVS: usize = 70;

fn batch(axes: Axes) -> (Box<dyn Batch>, BatchBuffers) {
    let recipe = Arc::new(Recipe::new(&KESSLER_TASKS[0]).unwrap());
    let observe = ObservationMode::All { bodies: None };
    let config = BatchConfig { axes, ..BatchConfig::new(AXES_ENVS, Autoreset::NextStep, observe) };
    let mut batch = KESSLER_TASKS[0].batch(Box::new(SeedSequence::new(recipe, 3)), config).unwrap();
    let mut buffers = BatchBuffers::new(batch.shape(), config.autoreset);
    batch.reset(None, &mut buffers.observations).unwrap();
    (batch, buffers)
}

/// Steps the batch and returns the executed actions.
fn step(batch: &mut dyn Batch, buffers: &mut BatchBuffers, actions: &[f32]) -> Vec<f32> {
    let mut executed = vec![f32::NAN; actions.len()];
    batch.step(actions, BatchOutput { executed_actions: &mut executed, ..buffers.output() }).unwrap();
    executed
}

#[test]
fn executed_actions_have_the_same_effect_on_world_axes() {
    let (mut own, mut own_buffers) = batch(Axes::Agent);
    let (mut world, mut world_buffers) = batch(Axes::World);
    let mut rng = SeededRng::new(Seed::user(8).unwrap());
    let mut resets = 0;
    for _ in 0..60 {
        let actions: Vec<f32> =
            (0..AXES_ENVS * 6).map(|_| rng.uniform_in(RngStream::Policy, -0.4, 0.4) as f32).collect();
        let was_done: Vec<bool> = own_buffers.done.clone();
        let executed = step(&mut *own, &mut own_buffers, &actions);
        assert_eq!(step(&mut *world, &mut world_buffers, &executed), executed);
        for env in 0..AXES_ENVS {
            assert_eq!(own.state_hash(env), world.state_hash(env));
            // A step that is a reset executes nothing. Otherwise the burn is rotated and keeps its size.
            for (burn, done) in actions[env * 6..][..6].chunks(2).zip(executed[env * 6..][..6].chunks(2)) {
                let size = |burn: &[f32]| burn[0].hypot(burn[1]);
                let expected = if was_done[env] { 0.0 } else { size(burn) };
                assert!((size(done) - expected).abs() < 1e-6, "{burn:?} {done:?}");
            }
            resets += usize::from(was_done[env]);
        }
        let mut observed = vec![f32::NAN; own_buffers.observations.len()];
        own.observe(&mut observed).unwrap();
        assert!(observed == own_buffers.observations);
    }
    assert!(resets > AXES_ENVS / 2);
}

#[test]
fn radial_points_outwards_and_in_track_along_the_motion() {
    let (mut own, mut buffers) = batch(Axes::Agent);
    let before = buffers.observations.clone();
    let width = own.shape().observation;
    let actions = [0.1, 0.0, 0.0, 0.1, 0.0, 0.0].repeat(AXES_ENVS);
    let executed = step(&mut *own, &mut buffers, &actions);
    for env in 0..AXES_ENVS {
        let satellite = |number: usize| &before[env * width + number * 6..][..4];
        let burn = |number: usize| &executed[env * 6 + number * 2..][..2];
        let dot = |a: &[f32], b: &[f32]| (a[0] * b[0] + a[1] * b[1]) / a[0].hypot(a[1]) / b[0].hypot(b[1]);
        // On a circular orbit the velocity is in-track. Bound: single precision leaves 1e-6.
        assert!((dot(&satellite(0)[..2], burn(0)) - 1.0).abs() < 1e-5);
        assert!((dot(&satellite(1)[2..4], burn(1)) - 1.0).abs() < 1e-5);
        assert_eq!(burn(2), [0.0, 0.0]);
    }
}

#[test]
fn scene_draws_earth_satellites_burns_and_debris() {
    let (mut own, mut buffers) = batch(Axes::Agent);
    let actions = [0.1, 0.0, 0.0, 0.1, 0.0, 0.0].repeat(AXES_ENVS);
    let executed = step(&mut *own, &mut buffers, &actions);
    let scene = own.scene(3, &executed[18..24]).unwrap();
    let marks = &scene.views[0].primitives;
    let count = |matches: &dyn Fn(&Primitive) -> bool| marks.iter().filter(|mark| matches(mark)).count();
    assert_eq!(count(&|mark| matches!(mark, Primitive::Disc { style: Style::Center, .. })), 1);
    assert_eq!(count(&|mark| matches!(mark, Primitive::Marker { style: Style::Agent(_), .. })), 3);
    assert_eq!(count(&|mark| matches!(mark, Primitive::Arrow { style: Style::Burn, .. })), 2);
    assert_eq!(count(&|mark| matches!(mark, Primitive::Disc { style: Style::Debris, .. })), 25);
    assert!(scene.status_lines.contains(&"step 1 of 50".to_owned()), "{:?}", scene.status_lines);
}
