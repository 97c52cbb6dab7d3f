"""RLlib's PPO learns to keep a scanning satellite alive, as in the paper on BSK-RL, which used it (Stephenson and Schaub 2024).

    pip install 'sparring[rllib]' matplotlib
    python examples/scanning_rllib.py --steps 2000000 --plot scanning.svg

The environment is the paper's, and no curriculum takes part. At intervals the policy acts in fresh episodes, and a line tells how
many of them it survives, and their mean return. The paper reports 94.5 % after 50 million steps. With --level 9 the scenarios are
the hardest ones.
"""

import argparse

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from scanning_survival import GAMMA, TASK, SurvivalCurve

import sparring.rllib

#: Steps of an environment per update.
FRAGMENT = 128


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=2_000_000, help="steps of all environments (%(default)s)")
    parser.add_argument("--env-runners", type=int, default=1, help="processes with environments (%(default)s)")
    parser.add_argument("--envs", type=int, default=64, help="environments per process (%(default)s)")
    parser.add_argument("--level", type=int, help="level of the task (default: the paper's params)")
    parser.add_argument("--evaluations", type=int, default=20, help="evaluations beside the first (%(default)s)")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of an evaluation (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the policy and its sampling (%(default)s)")
    parser.add_argument("--plot", help="file for a plot of the evaluations (needs matplotlib)")
    args = parser.parse_args()
    if min(args.steps, args.env_runners, args.envs, args.evaluations, args.episodes, args.seed) < 1:
        parser.error("--steps, --env-runners, --envs, --evaluations, --episodes and --seed must be >= 1")
    return args


def make_config(args, scenarios):
    batch = args.env_runners * args.envs * FRAGMENT
    return (
        PPOConfig()
        .environment(sparring.rllib.TEAM, env_config={"task": TASK, **scenarios})
        .env_runners(
            num_env_runners=args.env_runners,
            num_envs_per_env_runner=args.envs,
            rollout_fragment_length=FRAGMENT,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .training(
            train_batch_size_per_learner=batch,
            minibatch_size=max(batch // 4, 1),
            num_epochs=5,
            lr=[[0, 5e-4], [args.steps, 5e-5]],
            gamma=GAMMA,
            lambda_=0.95,
            use_kl_loss=False,
            entropy_coeff=0.005,
            grad_clip=0.5,
        )
        .rl_module(rl_module_spec=sparring.rllib.module_spec(TASK))
        .debugging(seed=args.seed)
    )


def main() -> None:
    args = parse_arguments()
    scenarios = {} if args.level is None else {"level": args.level}
    ray.init("local", log_to_driver=False, num_cpus=args.env_runners, object_store_memory=2**28, include_dashboard=False)
    algorithm = make_config(args, scenarios).build_algo()
    curve = SurvivalCurve("RLlib, PPO", scenarios, args.episodes, args.plot)
    every, steps = max(1, args.steps // args.evaluations), 0
    try:
        curve.evaluate(0, sparring.rllib.policy_fn(algorithm.get_module()))
        while steps < args.steps:
            before = steps
            steps = int(algorithm.train()["num_env_steps_sampled_lifetime"])
            if steps // every > before // every or steps >= args.steps:
                curve.evaluate(steps, sparring.rllib.policy_fn(algorithm.get_module()))
    finally:
        algorithm.stop()
        ray.shutdown()


if __name__ == "__main__":
    main()
