"""`python -m sparring.experiments`: the experiments there are."""

import sys

USAGE = """usage: python -m sparring.experiments {ppo,curriculum} ...

  ppo         one training by a learner in one file, in the manner of CleanRL
  curriculum  the same learner under several curricula, evaluated on held-out scenarios

Each has a --help."""


def main() -> int:
    """Hands over to one of them."""
    if not sys.argv[1:]:
        print(USAGE, file=sys.stderr)
        return 2
    name, *rest = sys.argv[1:]
    if name in ("-h", "--help"):
        print(USAGE)
        return 0
    try:
        if name == "ppo":
            from .ppo import main as ppo

            ppo(rest)
            return 0
        if name == "curriculum":
            from .command import main as curriculum

            return curriculum(rest)
    except ImportError as error:
        print(f"{error}: pip install 'sparring[experiments]'", file=sys.stderr)
        return 2
    print(f"{name!r} is no experiment: ppo or curriculum", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
