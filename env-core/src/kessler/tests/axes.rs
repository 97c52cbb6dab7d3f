//! Burns along each satellite's own axes: what a batch says was done is what it did, to the bit, and points where it should.

use std::sync::Arc;

use crate::batch::{Autoreset, Axes, Batch, BatchConfig, Buffers, Observe, Output, Seeds};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::scenario::Recipe;
use crate::scene::{Ink, Mark};
use crate::seed::Seed;
use crate::task::TaskSpec;

const ENVS: usize = 70;

fn batch(axes: Axes) -> (Box<dyn Batch>, Buffers) {
    let recipe = Arc::new(Recipe::new(&TASKS[0]).unwrap());
    let observe = Observe::All { bodies: None };
    let config = BatchConfig { axes, ..BatchConfig::new(ENVS, Autoreset::NextStep, observe) };
    let mut batch = TASKS[0].batch(Box::new(Seeds::new(recipe, 3)), config).unwrap();
    let mut buffers = Buffers::new(batch.shape(), config.autoreset);
    batch.reset(None, &mut buffers.observations).unwrap();
    (batch, buffers)
}

/// One step; what was done.
fn step(batch: &mut dyn Batch, buffers: &mut Buffers, actions: &[f32]) -> Vec<f32> {
    let mut taken = vec![f32::NAN; actions.len()];
    batch.step(actions, Output { taken: &mut taken, ..buffers.output() }).unwrap();
    taken
}

#[test]
fn what_was_done_along_the_worlds_axes_does_the_same() {
    let (mut own, mut own_buffers) = batch(Axes::Agent);
    let (mut world, mut world_buffers) = batch(Axes::World);
    let mut chance = Seeded::new(Seed::user(8).unwrap());
    let mut resets = 0;
    for _ in 0..60 {
        let actions: Vec<f32> =
            (0..ENVS * 6).map(|_| chance.between(Stream::Policy, -0.4, 0.4) as f32).collect();
        let over: Vec<bool> = own_buffers.done.clone();
        let taken = step(&mut *own, &mut own_buffers, &actions);
        assert_eq!(step(&mut *world, &mut world_buffers, &taken), taken);
        for env in 0..ENVS {
            assert_eq!(own.state_hash(env), world.state_hash(env));
            // A step that is a reset does nothing; one that is not turns the burn and leaves its size.
            for (burn, done) in actions[env * 6..][..6].chunks(2).zip(taken[env * 6..][..6].chunks(2)) {
                let size = |burn: &[f32]| burn[0].hypot(burn[1]);
                let wanted = if over[env] { 0.0 } else { size(burn) };
                assert!((size(done) - wanted).abs() < 1e-6, "{burn:?} {done:?}");
            }
            resets += usize::from(over[env]);
        }
        let mut again = vec![f32::NAN; own_buffers.observations.len()];
        own.observe(&mut again).unwrap();
        assert!(again == own_buffers.observations);
    }
    assert!(resets > ENVS / 2);
}

#[test]
fn radial_points_away_from_the_earth_and_in_track_along_the_flight() {
    let (mut own, mut buffers) = batch(Axes::Agent);
    let seen = buffers.observations.clone();
    let width = own.shape().observation;
    let actions = [0.1, 0.0, 0.0, 0.1, 0.0, 0.0].repeat(ENVS);
    let taken = step(&mut *own, &mut buffers, &actions);
    for env in 0..ENVS {
        let satellite = |number: usize| &seen[env * width + number * 6..][..4];
        let done = |number: usize| &taken[env * 6 + number * 2..][..2];
        let dot = |a: &[f32], b: &[f32]| (a[0] * b[0] + a[1] * b[1]) / a[0].hypot(a[1]) / b[0].hypot(b[1]);
        // On a circular orbit the velocity is in-track; single precision leaves 1e-6.
        assert!((dot(&satellite(0)[..2], done(0)) - 1.0).abs() < 1e-5);
        assert!((dot(&satellite(1)[2..4], done(1)) - 1.0).abs() < 1e-5);
        assert_eq!(done(2), [0.0, 0.0]);
    }
}

#[test]
fn a_scene_has_the_earth_the_satellites_their_burns_and_all_debris() {
    let (mut own, mut buffers) = batch(Axes::Agent);
    let actions = [0.1, 0.0, 0.0, 0.1, 0.0, 0.0].repeat(ENVS);
    let taken = step(&mut *own, &mut buffers, &actions);
    let scene = own.scene(3, &taken[18..24]).unwrap();
    let marks = &scene.views[0].marks;
    let count = |wanted: &dyn Fn(&Mark) -> bool| marks.iter().filter(|mark| wanted(mark)).count();
    assert_eq!(count(&|mark| matches!(mark, Mark::Disc { ink: Ink::Centre, .. })), 1);
    assert_eq!(count(&|mark| matches!(mark, Mark::Craft { ink: Ink::Agent(_), .. })), 3);
    assert_eq!(count(&|mark| matches!(mark, Mark::Arrow { ink: Ink::Burn, .. })), 2);
    assert_eq!(count(&|mark| matches!(mark, Mark::Disc { ink: Ink::Debris, .. })), 25);
    assert!(scene.told.contains(&"step 1 of 50".to_owned()), "{:?}", scene.told);
}
