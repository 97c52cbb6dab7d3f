"""RLlib's PPO with a curriculum: two env runners share one run.

    pip install 'sparring[rllib]' sparring-server
    python examples/rllib_ppo.py                                        # starts a server for this training
    python examples/rllib_ppo.py --task kessler/eco_station --iterations 80
    python examples/rllib_ppo.py --task docking/multiagent              # one agent per deputy, one policy for all
    sparring serve & python examples/rllib_ppo.py --url http://127.0.0.1:8700 --run my-run

In kessler one agent acts for all three satellites and receives the team's reward; its module controls each satellite from its own
row (`sparring.rllib.module_spec`). With --agents, and in docking, each satellite or deputy is an agent; deputies have rewards of
their own. --tensorboard writes the return and the curriculum's metrics; with Tune, which is not used here, RLlib writes them.

Several hosts can share one server. In this example `head` has the server and Ray's head. All hosts need sparring and two tokens:
one of the server, which it requires at an address that others can reach, and Ray's own (the same ~/.ray/auth_token on all hosts).

    head$  sparring token create rllib --role trainer --db training.sqlite3       # printed once
    head$  sparring serve --db training.sqlite3 --bind 0.0.0.0:8700 &
    head$  ray get-auth-token --generate
    all$   export SPARRING_TOKEN=... RAY_AUTH_MODE=token                          # before `ray start`
    head$  ray start --head
    other$ ray start --address head:6379
    head$  python examples/rllib_ppo.py --ray auto --url http://head:8700 --env-runners 16

Env runners connect to the address in --url, so all hosts must know that name. The token is in the environment of `ray start`,
since RLlib writes env_configs to checkpoints.
"""

import argparse
import time

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from tensorboardX import SummaryWriter

import sparring
import sparring.rllib

# Name of the policy of all agents.
POLICY = "shared"


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="kessler/survival", help="id of a task, such as docking/multiagent (%(default)s)")
    parser.add_argument("--url", help="address of a running server (default: start one)")
    parser.add_argument("--run", help="id of a run of that server to continue (default: create one)")
    parser.add_argument("--agents", action="store_true", help="make each satellite an agent, which is slower")
    parser.add_argument("--iterations", type=int, default=40, help="training iterations (%(default)s)")
    parser.add_argument("--env-runners", type=int, default=2, help="processes with environments (%(default)s)")
    parser.add_argument(
        "--envs", type=int, default=32, help="environments per process, at most 8 with several agents (%(default)s)"
    )
    parser.add_argument("--steps", type=int, help="steps of an environment per update (50 in kessler, 400 in docking)")
    parser.add_argument("--ray", default="local", help="address of Ray; `auto` for the cluster of `ray start` (%(default)s)")
    parser.add_argument("--tensorboard", help="folder for TensorBoard")
    parser.add_argument("--no-evaluation", action="store_true", help="skip the evaluation on kessler's held-out suite")
    args = parser.parse_args()
    if min(args.iterations, args.env_runners, args.envs, args.steps or 1) < 1:
        parser.error("--iterations, --env-runners, --envs and --steps must be >= 1")
    return args, parser


def make_config(args, curriculum):
    is_multi_agent = args.agents or args.task.startswith("docking")
    envs = min(args.envs, 8) if is_multi_agent else args.envs
    steps = args.steps or (400 if args.task.startswith("docking") else 50)
    batch = args.env_runners * envs * steps
    token = {} if args.url else {"token": ""}  # a local server has no tokens
    env_config = {"task": args.task, "curriculum": {"url": curriculum.url, "run": curriculum.run, **token}}
    config = (
        PPOConfig()
        .environment(sparring.rllib.AGENTS if is_multi_agent else sparring.rllib.TEAM, env_config=env_config)
        .env_runners(
            num_env_runners=args.env_runners,
            num_envs_per_env_runner=envs,
            rollout_fragment_length=steps,
            gym_env_vectorize_mode="sync" if is_multi_agent else "vector_entry_point",
        )
        .training(
            train_batch_size_per_learner=batch,
            minibatch_size=max(batch // 4, 1),
            num_epochs=8,
            lr=5e-4,
            gamma=0.97 if args.task.startswith("kessler") else 0.99,
            lambda_=0.9,
            use_kl_loss=False,
            entropy_coeff=0.0,
            grad_clip=0.5,
        )
        .callbacks(sparring.rllib.CurriculumCallback)
    )
    spec = sparring.rllib.module_spec(args.task)
    if is_multi_agent:
        config.multi_agent(policies={POLICY}, policy_mapping_fn=lambda agent, episode, **_: POLICY)
        spec = MultiRLModuleSpec(rl_module_specs={POLICY: spec})
    return config.rl_module(rl_module_spec=spec)


def print_result(iteration, result, task, seconds):
    env_runners, metrics = result.get("env_runners", {}), result["curriculum"]

    def metric(name):
        return format(metrics.get(f"{task}/{name}", float("nan")), ".2f")

    print(
        f"{iteration:>4}  return {env_runners.get('episode_return_mean', float('nan')):8.3f}  level {metric('level')}  "
        f"mastery {metric('mastery')}  skill {metric('skill')}  {metrics.get('episodes/finished', 0):>7,.0f} episodes  "
        f"{env_runners.get('num_env_steps_sampled', 0) / seconds:>7,.0f} env-steps/s",
        flush=True,
    )


def write_metrics(writer, iteration, result):
    writer.add_scalar("return", result.get("env_runners", {}).get("episode_return_mean", float("nan")), iteration)
    for name, value in result["curriculum"].items():
        writer.add_scalar(f"curriculum/{name}", value, iteration)


def train(args, curriculum):
    """Trains; returns a function from observations to actions for `sparring.evaluate`."""
    writer = SummaryWriter(args.tensorboard) if args.tensorboard else None
    local = {"num_cpus": args.env_runners, "object_store_memory": 2**28, "include_dashboard": False}
    ray.init(args.ray, log_to_driver=False, **(local if args.ray == "local" else {}))
    algorithm = make_config(args, curriculum).build_algo()
    try:
        for iteration in range(1, args.iterations + 1):
            started = time.perf_counter()
            result = algorithm.train()
            print_result(iteration, result, args.task, time.perf_counter() - started)
            if writer:
                write_metrics(writer, iteration, result)
        is_multi_agent = algorithm.config.is_multi_agent
        return sparring.rllib.policy_fn(algorithm.get_module(POLICY) if is_multi_agent else algorithm.get_module())
    finally:
        # Env runners submit their results and release unfinished episodes.
        algorithm.stop()
        ray.shutdown()
        if writer:
            writer.close()


def main():
    args, parser = parse_arguments()
    try:
        curriculum = sparring.Curriculum.open(args.url, args.run, settings={"tasks": [args.task]})
    except (sparring.CurriculumError, ValueError) as error:
        parser.error(str(error))
    with curriculum:
        print(f"run {curriculum.run} at {curriculum.url}", flush=True)
        policy = train(args, curriculum)
        if args.task.startswith("kessler") and not args.no_evaluation:
            curriculum.policy_version += args.iterations
            result = sparring.evaluate(curriculum, policy, policy="rllib-ppo", stochastic=False)
            for task in curriculum.tasks:
                skill = result.mean(task)
                skill_text = "no" if skill is None else f"{skill:.3f}"
                print(f"{task}: {skill_text} skill on held-out contested scenarios ({result.id})")


if __name__ == "__main__":
    main()
