"""`python -m sparring.experiments`: selects an experiment."""

import sys

USAGE = """usage: python -m sparring.experiments {ppo,curriculum,evidence} ...

  ppo         Train a policy by PPO in one file, in the manner of CleanRL
  curriculum  Compare several curricula with the same learner on held-out scenarios
  evidence    Run the trainings of the evidence protocol, and write its tables and figures

`python -m sparring.experiments ppo --help` lists the options of an experiment."""


def main() -> int:
    """Runs the command line of an experiment; returns its exit status."""
    if not sys.argv[1:]:
        print(USAGE, file=sys.stderr)
        return 2
    name, *arguments = sys.argv[1:]
    if name in ("-h", "--help"):
        print(USAGE)
        return 0
    try:
        if name == "ppo":
            from .ppo_cli import main as run_ppo

            run_ppo(arguments)
            return 0
        if name == "curriculum":
            from .cli import main as run_curriculum

            return run_curriculum(arguments)
        if name == "evidence":
            from .evidence.cli import main as run_evidence

            return run_evidence(arguments)
    except ImportError as error:
        remedy = "" if "pip install" in str(error) else ": pip install 'sparring[experiments]'"
        print(f"{error}{remedy}", file=sys.stderr)
        return 2
    print(f"the experiment must be ppo, curriculum or evidence, got {name!r}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
