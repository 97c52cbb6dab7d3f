//! Compares the motion with the equations of Clohessy & Wiltshire (1960).

use nalgebra::SMatrix;

use crate::docking::constants::{MASS_KG, MEAN_MOTION_RAD_S as N};
use crate::docking::relative_motion::{RelativeState, StepTransition, Transition};

/// ds/dt: ẍ = 3n²x + 2nẏ + Fx/m, ÿ = −2nẋ + Fy/m, z̈ = −n²z + Fz/m.
fn derivative(s: &RelativeState, f: [f64; 3]) -> RelativeState {
    [
        s[3],
        s[4],
        s[5],
        3.0 * N * N * s[0] + 2.0 * N * s[4] + f[0] / MASS_KG,
        -2.0 * N * s[3] + f[1] / MASS_KG,
        -N * N * s[2] + f[2] / MASS_KG,
    ]
}

/// Φ and Γ are the upper blocks of the exponential of [A B; 0 0]·t.
#[test]
fn validate_nalgebra_matrix_exponential_agrees() {
    for seconds in [0.5, 1.0, 7.0, 60.0, 300.0, 1500.0] {
        let mut augmented = SMatrix::<f64, 9, 9>::zeros();
        for column in 0..6 {
            let mut unit = [0.0; 6];
            unit[column] = 1.0;
            for (row, value) in derivative(&unit, [0.0; 3]).into_iter().enumerate() {
                augmented[(row, column)] = value * seconds;
            }
        }
        for axis in 0..3 {
            let mut unit = [0.0; 3];
            unit[axis] = 1.0;
            for (row, value) in derivative(&[0.0; 6], unit).into_iter().enumerate() {
                augmented[(row, 6 + axis)] = value * seconds;
            }
        }
        let exponential = augmented.exp();
        let Transition { phi, gamma } = Transition::over(seconds);
        // Padé approximation and squaring lose a few roundings of the largest entry; 1e-13 of it allows for 450.
        let allowed = 1e-13 * (1.0 + exponential.abs().max());
        assert!((exponential.fixed_view::<6, 6>(0, 0) - phi).abs().max() < allowed, "{seconds}");
        assert!((exponential.fixed_view::<6, 3>(0, 6) - gamma).abs().max() < allowed, "{seconds}");
    }
}

/// The step of the simulation equals Φ and Γ in every entry.
#[test]
fn step_equals_the_transition_over_one_second() {
    let Transition { phi, gamma } = Transition::over(1.0);
    for column in 0..9 {
        let (mut state, mut thrust) = ([0.0; 6], [0.0; 3]);
        if column < 6 {
            state[column] = 1.0;
        } else {
            thrust[column - 6] = 1.0;
        }
        let moved = StepTransition::world_step().advance(&state, thrust);
        for (row, value) in moved.into_iter().enumerate() {
            let expected = if column < 6 { phi[(row, column)] } else { gamma[(row, column - 6)] };
            assert_eq!(value, expected, "{row} {column}");
        }
    }
}

/// Compares with a Runge–Kutta method of fourth order, which does not use the closed form.
#[test]
fn validate_clohessy_wiltshire_numerical_integration() {
    let mut ours: RelativeState = [120.0, -80.0, 40.0, -0.3, 0.2, 0.1];
    let mut theirs = ours;
    for second in 0..600 {
        let push = f64::from(second % 7) / 7.0 - 0.4;
        let thrust = [push, -0.5 * push, 0.3];
        ours = StepTransition::world_step().advance(&ours, thrust);
        let add = |s: &RelativeState, d: &RelativeState, h: f64| -> RelativeState {
            std::array::from_fn(|i| s[i] + h * d[i])
        };
        let a = derivative(&theirs, thrust);
        let b = derivative(&add(&theirs, &a, 0.5), thrust);
        let c = derivative(&add(&theirs, &b, 0.5), thrust);
        let d = derivative(&add(&theirs, &c, 1.0), thrust);
        theirs = std::array::from_fn(|i| theirs[i] + (a[i] + 2.0 * (b[i] + c[i]) + d[i]) / 6.0);
    }
    for (ours, theirs) in ours.into_iter().zip(theirs) {
        // The error of the method is about n⁵ of the state per step (1e-15 of 1e4 m): far below 1e-8 after 600 steps.
        assert!((ours - theirs).abs() < 1e-8, "{ours} {theirs}");
    }
}

fn coast(mut state: RelativeState, steps: u32) -> RelativeState {
    for _ in 0..steps {
        state = StepTransition::world_step().advance(&state, [0.0; 3]);
    }
    state
}

/// With ẏ₀ = −2n x₀ there is no drift: the path is an ellipse twice as long in-track as radially, x = x₀ cos nt,
/// y = −2x₀ sin nt, and cross-track z = z₀ cos nt. Rounding is about 1e-14 m per step and grows with the shear, so 1e-7
/// after 6 118 steps is a safe bound.
#[test]
fn validate_clohessy_wiltshire_two_by_one_ellipse() {
    let mut state: RelativeState = [100.0, 0.0, 50.0, 0.0, -2.0 * N * 100.0, 0.0];
    let (mut widest, mut longest) = (0.0f64, 0.0f64);
    for second in 1..=6118 {
        state = StepTransition::world_step().advance(&state, [0.0; 3]);
        let (sin, cos) = libm::sincos(N * f64::from(second));
        for (ours, theirs) in [(state[0], 100.0 * cos), (state[1], -200.0 * sin), (state[2], 50.0 * cos)] {
            assert!((ours - theirs).abs() < 1e-7, "{second}: {ours} {theirs}");
        }
        widest = widest.max(state[0].abs());
        longest = longest.max(state[1].abs());
    }
    assert!((longest / widest - 2.0).abs() < 1e-6);
}

/// Secular drift per orbit: −12π x₀ from rest at x₀; −6π ẏ₀/n after a push in-track; −3π x₀ on the circular orbit at x₀
/// (ẏ₀ = −1.5n x₀).
#[test]
fn validate_clohessy_wiltshire_secular_drift() {
    use std::f64::consts::PI;
    let orbit = 2.0 * PI / N;
    let after = |state: RelativeState| Transition::over(orbit).phi * nalgebra::SVector::<f64, 6>::from(state);
    // The error of sin and cos of 2π is about 3e-16, times 6x₀: 1e-9 is a safe bound.
    assert!((after([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])[1] + 12.0 * PI * 10.0).abs() < 1e-9);
    assert!((after([0.0, 0.0, 0.0, 0.0, 0.01, 0.0])[1] + 6.0 * PI * 0.01 / N).abs() < 1e-9);
    assert!((after([10.0, 0.0, 0.0, 0.0, -1.5 * N * 10.0, 0.0])[1] + 3.0 * PI * 10.0).abs() < 1e-9);
    // Step by step over one orbit without its last fraction of a second.
    let steps = libm::floor(orbit) as u32;
    let (state, seconds) = (coast([10.0, 0.0, 0.0, 0.0, 0.0, 0.0], steps), f64::from(steps));
    let expected = 60.0 * (libm::sin(N * seconds) - N * seconds);
    assert!((state[1] - expected).abs() < 1e-6, "{} {expected}", state[1]);
}

/// Rest in-track is an equilibrium, and the effect of a constant thrust over k seconds is Γ(k).
#[test]
fn validate_clohessy_wiltshire_equilibrium_and_held_thrust() {
    assert_eq!(coast([0.0, 100.0, 0.0, 0.0, 0.0, 0.0], 2000), [0.0, 100.0, 0.0, 0.0, 0.0, 0.0]);
    let mut state: RelativeState = [0.0; 6];
    for _ in 0..200 {
        state = StepTransition::world_step().advance(&state, [0.7, -0.2, 0.1]);
    }
    let held = Transition::over(200.0).gamma * nalgebra::Vector3::new(0.7, -0.2, 0.1);
    for (value, held) in state.into_iter().zip(held.iter()) {
        // The rounding of 200 steps at 1e3 m: 1e-13 each.
        assert!((value - held).abs() < 1e-9, "{value} {held}");
    }
}
