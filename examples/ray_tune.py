"""Ray Tune with RLlib's PPO: each trial trains on the curriculum of a run of its own.

    pip install 'sparring[rllib]' sparring-server
    sparring serve --db tune.sqlite3 &
    python examples/ray_tune.py --strategies auto ladder --lrs 5e-4 1e-3 --iterations 40
    python examples/ray_tune.py --ray auto --url http://head:8700 --storage /shared/tune --env-runners 4

A trial's run has the name of the trial, its strategy, and tags such as `lr:0.0005`, by which the dashboard filters and groups
runs. Results have RLlib's metrics and those of the run: skill, rung, level and mastery. The lines at the end compare the trials.

The same command continues an experiment that was interrupted: finished trials are not repeated, and the others continue from
their last checkpoints in the same runs. After the failure of a node, Tune starts its trials again, also in the same runs. With
--ray, --storage must be a folder or a bucket that all nodes can reach. Tokens are in `SPARRING_TOKEN`, as in rllib_ppo.py.
"""

import argparse
import os

import ray
from ray import tune
from ray.rllib.algorithms.ppo import PPO, PPOConfig

import sparring
import sparring.rllib
import sparring.tune


def make_config(args):
    """Makes the config of all trials, in which strategy and learning rate have several values."""
    settings = {"tasks": [args.task], "strategy": tune.grid_search(args.strategies)}
    batch = max(args.env_runners, 1) * args.envs * args.steps
    return (
        PPOConfig()
        .environment(sparring.rllib.TEAM, env_config={"task": args.task, "curriculum": {"url": args.url, "settings": settings}})
        .env_runners(
            num_env_runners=args.env_runners,
            num_envs_per_env_runner=args.envs,
            rollout_fragment_length=args.steps,
            gym_env_vectorize_mode="vector_entry_point",
        )
        .training(
            lr=tune.grid_search(args.lrs),
            train_batch_size_per_learner=batch,
            minibatch_size=max(batch // 4, 1),
            num_epochs=8,
            gamma=0.97,
            lambda_=0.9,
            use_kl_loss=False,
            grad_clip=0.5,
        )
        .rl_module(rl_module_spec=sparring.rllib.module_spec(args.task))
        .callbacks(sparring.rllib.CurriculumCallback)
    )


def run_experiment(args):
    """Runs all trials, or the rest of an interrupted experiment; returns Tune's results."""
    # A run that shows its learning rate as a tag can be found and grouped by it.
    trainable, config = sparring.tune.run_per_trial(PPO, tags=["lr"]), make_config(args)
    path = os.path.join(args.storage, args.experiment)
    if tune.Tuner.can_restore(path):
        print(f"continues the experiment in {path}", flush=True)
        tuner = tune.Tuner.restore(path, trainable=trainable, resume_errored=True)
        return tuner.fit()
    skill = f"curriculum/{args.task}/skill"
    tuner = tune.Tuner(
        trainable,
        param_space=config.to_dict(),
        tune_config=tune.TuneConfig(metric=skill, mode="max", max_concurrent_trials=args.concurrent),
        run_config=tune.RunConfig(
            name=args.experiment,
            storage_path=args.storage,
            stop={"training_iteration": args.iterations},
            failure_config=tune.FailureConfig(max_failures=3),
            checkpoint_config=tune.CheckpointConfig(num_to_keep=2, checkpoint_frequency=args.checkpoint, checkpoint_at_end=True),
            verbose=args.verbose,
        ),
    )
    return tuner.fit()


def print_results(results, task, url):
    """Prints a line for each trial, with the settings and the number of episodes that the server has."""
    for result in results:
        run, curriculum = result.metrics.get("curriculum_run"), result.metrics.get("curriculum", {})
        if run is None:
            print(f"no iteration: {result.error}")
            continue
        stored = sparring.Curriculum(url, run).request("GET", f"/v1/runs/{run}")
        numbers = "  ".join(f"{name} {curriculum.get(f'{task}/{name}', float('nan')):.2f}" for name in ("skill", "rung", "level"))
        returned = result.metrics.get("env_runners", {}).get("episode_return_mean", float("nan"))
        print(
            f"{run}  strategy {stored['settings']['curriculum']['strategy']}  lr {result.config['lr']:g}  "
            f"iterations {result.metrics['training_iteration']}  episodes {stored['episodes']}  return {returned:.3f}  {numbers}"
            + (f"  error {result.error}" if result.error else ""),
            flush=True,
        )


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="kessler/survival", help="id of a task of kessler (%(default)s)")
    parser.add_argument("--strategies", nargs="+", default=["auto", "uniform"], help="strategies to compare (%(default)s)")
    parser.add_argument("--lrs", nargs="+", type=float, default=[5e-4], help="learning rates to compare (%(default)s)")
    parser.add_argument("--iterations", type=int, default=40, help="training iterations of a trial (%(default)s)")
    parser.add_argument("--env-runners", type=int, default=1, help="processes with environments of a trial (%(default)s)")
    parser.add_argument("--envs", type=int, default=32, help="environments of a process (%(default)s)")
    parser.add_argument("--steps", type=int, default=50, help="steps of an environment per update (%(default)s)")
    parser.add_argument("--concurrent", type=int, help="largest number of trials at a time (default: as resources allow)")
    parser.add_argument("--checkpoint", type=int, default=5, help="iterations between two checkpoints (%(default)s)")
    parser.add_argument("--experiment", default="sparring", help="name of the experiment (%(default)s)")
    parser.add_argument("--storage", default=os.path.expanduser("~/ray_results"), help="folder of experiments (%(default)s)")
    parser.add_argument("--url", default="http://127.0.0.1:8700", help="address of the server (%(default)s)")
    parser.add_argument("--ray", default="local", help="address of Ray; `auto` for the cluster of `ray start` (%(default)s)")
    parser.add_argument("--cpus", type=int, help="cores of Ray on this machine (default: all)")
    parser.add_argument("--verbose", type=int, choices=[0, 1, 2], default=1, help="amount of Tune's output (%(default)s)")
    args = parser.parse_args()
    if min(args.iterations, args.envs, args.steps, args.checkpoint) < 1 or args.env_runners < 0:
        parser.error("--iterations, --envs, --steps and --checkpoint must be >= 1, and --env-runners >= 0")
    return args


def main():
    args = parse_arguments()
    local = {"num_cpus": args.cpus, "include_dashboard": False, "object_store_memory": 2**28}
    ray.init(args.ray, log_to_driver=False, **(local if args.ray == "local" else {}))
    results = run_experiment(args)
    print_results(results, args.task, args.url)
    ray.shutdown()
    if results.num_errors:
        raise SystemExit(f"{results.num_errors} trial(s) failed")


if __name__ == "__main__":
    main()
