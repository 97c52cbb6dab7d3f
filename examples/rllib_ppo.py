"""RLlib's PPO through the curriculum: two env runners, one run.

    pip install 'sparring[rllib]' sparring-server
    python examples/rllib_ppo.py                                        # starts a server for as long as it trains
    python examples/rllib_ppo.py --task kessler/eco_station --iterations 80
    python examples/rllib_ppo.py --task docking/multiagent              # an agent for each deputy, one policy for all
    sparring serve & python examples/rllib_ppo.py --url http://127.0.0.1:8700 --run my-run

In kessler one agent acts for all three satellites and is paid what the team earns; its module flies each from its own row
(`sparring.rllib.module`). With --agents, and in docking, each satellite or deputy is an agent; deputies are paid for themselves.
--tensorboard writes the curriculum's numbers beside the return; Tune, which this does without, writes all there are by itself.

Several hosts share one server: here `head` has it, and Ray's head. All need sparring, and two tokens: the server's, since an
address that others reach wants one, and Ray's own (the same ~/.ray/auth_token on all hosts).

    head$  sparring token create rllib --role trainer --db training.sqlite3       # printed once
    head$  sparring serve --db training.sqlite3 --bind 0.0.0.0:8700 &
    head$  ray get-auth-token --generate
    all$   export SPARRING_TOKEN=... RAY_AUTH_MODE=token                          # before `ray start`
    head$  ray start --head
    other$ ray start --address head:6379
    head$  python examples/rllib_ppo.py --ray auto --url http://head:8700 --env-runners 16

Env runners find the server by --url, so it has to be a name that all hosts know; the token is in the environment that `ray start`
was given, since what is in an env_config is written into checkpoints.
"""

import argparse
import time

import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from tensorboardX import SummaryWriter

import sparring
import sparring.rllib

POLICY = "shared"


def options():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="kessler/survival", help="as kessler/eco_station or docking/multiagent")
    parser.add_argument("--url", help="a server (`sparring serve`); one is started for as long as this runs otherwise")
    parser.add_argument("--run", help="a run of that server, to go on with; one is created otherwise")
    parser.add_argument("--agents", action="store_true", help="an agent for each satellite, too: slower")
    parser.add_argument("--iterations", type=int, default=40)
    parser.add_argument("--env-runners", type=int, default=2, help="processes that fly; each takes part in the run by itself")
    parser.add_argument("--envs", type=int, default=32, help="environments of each, 8 where each satellite is an agent")
    parser.add_argument(
        "--steps", type=int, help="of an environment between two updates (50, an episode of kessler; 400 of docking)"
    )
    parser.add_argument("--ray", default="local", help="where Ray runs: `auto` finds what `ray start` has started")
    parser.add_argument("--tensorboard", help="a folder for TensorBoard")
    parser.add_argument("--no-evaluation", action="store_true", help="do without the held-out suite of kessler at the end")
    args = parser.parse_args()
    if min(args.iterations, args.env_runners, args.envs, args.steps or 1) < 1:
        parser.error("--iterations, --env-runners, --envs and --steps are 1 at least")
    return args, parser


def config_of(args, curriculum):
    several = args.agents or args.task.startswith("docking")
    envs = min(args.envs, 8) if several else args.envs
    steps = args.steps or (400 if args.task.startswith("docking") else 50)
    batch = args.env_runners * envs * steps
    token = {} if args.url else {"token": ""}  # a server that was started here knows none
    env_config = {"task": args.task, "curriculum": {"url": curriculum.url, "run": curriculum.run, **token}}
    config = (
        PPOConfig()
        .environment(sparring.rllib.AGENTS if several else sparring.rllib.TEAM, env_config=env_config)
        .env_runners(
            num_env_runners=args.env_runners,
            num_envs_per_env_runner=envs,
            rollout_fragment_length=steps,
            gym_env_vectorize_mode="sync" if several else "vector_entry_point",
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
    module = sparring.rllib.module(args.task)
    if several:
        config.multi_agent(policies={POLICY}, policy_mapping_fn=lambda agent, episode, **_: POLICY)
        module = MultiRLModuleSpec(rl_module_specs={POLICY: module})
    return config.rl_module(rl_module_spec=module)


def report(iteration, result, task, took):
    told, numbers = result.get("env_runners", {}), result["curriculum"]

    def number(name):
        return format(numbers.get(f"{task}/{name}", float("nan")), ".2f")

    print(
        f"{iteration:>4}  return {told.get('episode_return_mean', float('nan')):8.3f}  level {number('level')}  "
        f"mastery {number('mastery')}  skill {number('skill')}  {numbers.get('episodes/flown', 0):>7,.0f} episodes  "
        f"{told.get('num_env_steps_sampled', 0) / took:>7,.0f} env-steps/s",
        flush=True,
    )


def write(board, iteration, result):
    board.add_scalar("return", result.get("env_runners", {}).get("episode_return_mean", float("nan")), iteration)
    for name, value in result["curriculum"].items():
        board.add_scalar(f"curriculum/{name}", value, iteration)


def main():
    args, parser = options()
    board = SummaryWriter(args.tensorboard) if args.tensorboard else None
    try:
        curriculum = sparring.Curriculum.find(args.url, args.run, settings={"tasks": [args.task]})
    except (sparring.CurriculumError, ValueError) as error:
        parser.error(str(error))
    with curriculum:
        print(f"run {curriculum.run} at {curriculum.url}", flush=True)
        here = {"num_cpus": args.env_runners, "object_store_memory": 2**28, "include_dashboard": False}
        ray.init(args.ray, log_to_driver=False, **(here if args.ray == "local" else {}))
        algorithm = config_of(args, curriculum).build_algo()
        try:
            for iteration in range(1, args.iterations + 1):
                began = time.perf_counter()
                result = algorithm.train()
                report(iteration, result, args.task, time.perf_counter() - began)
                if board:
                    write(board, iteration, result)
            several = algorithm.config.is_multi_agent
            policy = sparring.rllib.act(algorithm.get_module(POLICY) if several else algorithm.get_module())
        finally:
            # Env runners hand in what they flew, and give back what they did not.
            algorithm.stop()
            ray.shutdown()
            if board:
                board.close()
        if args.task.startswith("kessler") and not args.no_evaluation:
            curriculum.policy_version += args.iterations
            told = sparring.evaluate(curriculum, policy, policy="rllib-ppo", chance=False)
            for task in curriculum.tasks:
                skill = told.of(task)
                shown = "no" if skill is None else f"{skill:.3f}"
                print(f"{task}: {shown} skill on held-out contested scenarios ({told.id})")


if __name__ == "__main__":
    main()
