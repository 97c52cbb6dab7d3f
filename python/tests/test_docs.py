"""Code blocks and commands of the documentation run as printed."""

import contextlib
import io
import os
import re
import shlex
import subprocess

import documents
import numpy as np
import pytest
from conftest import BINARY, needs_server
from curriculum_servers import local_curriculum
from documents import ROOT, URL, code_blocks, commands, pages, printed_output, read_page, replace_all, run_command

import sparring

#: Python with openenv-core, msgpack and websockets.
OPENENV_PYTHON = ROOT / "target/openenv-venv/bin/python"
#: Test that runs all Python blocks of a page.
CODE_TESTS = {
    "README.md": "python/tests/test_docs.py::test_readme_environments_run",
    "docs/guides/evaluate.md": "python/tests/test_docs.py::test_evaluation_code_runs",
    "docs/guides/export-onnx.md": "python/tests/trainers/test_onnx_export.py::test_printed_code_exports",
    "docs/guides/from-bsk-rl.md": "python/tests/tasking_api/test_guide.py::test_printed_code_runs",
    "docs/guides/log-metrics.md": "python/tests/heavy/test_loggers_heavy.py::test_printed_loggers_store_the_numbers",
    "docs/guides/ray.md": "python/tests/heavy/test_ray_printed.py::test_printed_code_trains",
    "docs/guides/train-own-loop.md": "python/tests/test_docs.py::test_own_loop_page_runs_from_top_to_bottom",
    "docs/guides/train-rllib.md": "python/tests/heavy/test_printed.py::test_printed_algorithm_trains",
    "docs/guides/train-trl.md": "python/tests/heavy/test_printed.py::test_printed_trainer_trains",
    "docs/guides/train-verifiers.md": "python/tests/heavy/test_verifiers.py::test_printed_evaluation_runs",
    "docs/reference/data.md": "python/tests/heavy/test_data_export.py::test_printed_code_reads_the_tables",
    "docs/reference/openenv.md": "tests/clients/openenv_clients.py::run_documented_examples",
    "docs/reference/trajectories.md": "python/tests/test_feed.py::test_printed_code_reads_a_feed",
    "docs/reference/python.md": "python/tests/test_docs.py::test_python_page_runs_from_top_to_bottom",
    "python/README.md": "python/tests/test_docs.py::test_package_readme_code_runs",
}
PRINTED_EXAMPLE = "python/tests/test_docs.py::test_printed_examples_run"
RAY_COMMANDS = "python/tests/heavy/test_ray_printed.py::test_printed_commands_train_on_started_nodes"
PLANNED_EVIDENCE = "python/tests/trainers/test_evidence.py::test_printed_commands_plan_trainings"
README_TRAINER = "python/tests/test_docs.py::test_readme_trainer_learns"
#: Test that runs the commands of a page that start with these words; `pip` commands have a test of their own.
COMMAND_TESTS = {
    ("README.md", "python examples/first_trainer.py"): README_TRAINER,
    ("docs/guides/first-run.md", "python examples/first_trainer.py"): README_TRAINER,
    ("docs/guides/train-own-loop.md", "python -m sparring.experiments ppo"): (
        "python/tests/trainers/test_experiments.py::test_printed_commands_train"
    ),
    ("docs/guides/train-own-loop.md", "python -m sparring.experiments curriculum"): (
        "python/tests/trainers/test_curricula_compared.py::test_printed_commands_define_experiments"
    ),
    ("docs/guides/train-own-loop.md", "python -m sparring.experiments evidence"): (
        "python/tests/trainers/test_evidence.py::test_printed_command_learns_from_groups"
    ),
    ("docs/guides/ray.md", "python examples/"): RAY_COMMANDS,
    ("docs/guides/train-rllib.md", "python examples/scanning_rllib.py"): (
        "python/tests/heavy/test_printed.py::test_printed_scanning_command_trains_and_plots"
    ),
    ("docs/guides/train-sb3.md", "python examples/sb3_ppo.py"): (
        "python/tests/trainers/test_sb3.py::test_printed_command_trains_evaluates_and_saves"
    ),
    ("docs/guides/train-sb3.md", "python examples/scanning_sb3.py"): (
        "python/tests/trainers/test_sb3.py::test_printed_scanning_command_trains_and_plots"
    ),
    ("docs/guides/train-trl.md", "python examples/grpo_in_process.py --tiny"): (
        "python/tests/heavy/test_trl.py::test_printed_command_trains"
    ),
    ("docs/guides/train-trl.md", "python examples/grpo_async.py --tiny"): (
        "python/tests/heavy/test_trl_async.py::test_printed_command_trains"
    ),
    ("docs/guides/train-trl.md", "python examples/grpo_in_process.py --url"): (
        "python/tests/heavy/test_printed.py::test_printed_gpu_commands_train"
    ),
    ("docs/guides/train-trl.md", "torchrun"): "python/tests/heavy/test_printed.py::test_printed_gpu_commands_train",
    ("docs/guides/choose-a-curriculum.md", "python -m sparring.experiments evidence"): PLANNED_EVIDENCE,
    ("docs/reference/evidence-protocol.md", "python -m sparring.experiments evidence"): PLANNED_EVIDENCE,
    ("docs/reference/evidence-results.md", "python -m sparring.experiments evidence"): PLANNED_EVIDENCE,
    ("docs/reference/feed.md", "python examples/"): PRINTED_EXAMPLE,
    ("docs/reference/openenv.md", "python examples/grpo_openenv.py"): (
        "python/tests/heavy/test_printed.py::test_printed_openenv_command_trains"
    ),
    ("docs/reference/strategies-measured.md", "python -m sparring.experiments curriculum"): (
        "python/tests/trainers/test_curricula_compared.py::test_printed_commands_define_experiments"
    ),
    ("docs/reference/trajectories.md", "python examples/trajectories.py"): PRINTED_EXAMPLE,
    ("docs/reference/trajectories.md", "python examples/feed_nats.py"): (
        "tests/tests/system/feed_stream/example.rs::example_trains_alone_and_beside_another"
    ),
}
#: Extra that a snippet needs, by a part of its text.
EXTRAS_OF_FEATURES = {
    "parallel_env(": "pettingzoo",
    "sparring.Client(": "client",
    "sparring.feed.nats(": "nats",
    "sparring.sb3": "sb3",
    "sparring.rllib": "rllib",
    "sparring.tune": "rllib",
    "sparring.trl": "trl",
    "sparring.experiments": "experiments",
    "sparring.export_onnx(": "onnx",
}
#: Command that pip installs packages with, up to the end of its quotation.
PIP_INSTALL = re.compile(r"pip install ((?:[-\w./=<>]+|'[^']+')(?: (?:[-\w./=<>]+|'[^']+'))*)")


def find_test(test):
    """Returns the code of a test, given as `file::function`."""
    file, name = test.split("::")
    code = read_page(file)
    assert re.search(rf"\b(?:def|fn) {name}\(", code), f"{file} has no {name}"
    return code


@pytest.mark.parametrize("page", pages())
def test_every_printed_block_has_a_test(page):
    if code_blocks(page):
        assert page in CODE_TESTS, f"no test runs the Python blocks of {page}"
        find_test(CODE_TESTS[page])
    for command in commands(page):
        if command.startswith("pip "):
            continue
        tests = [test for (covered, start), test in COMMAND_TESTS.items() if covered == page and command.startswith(start)]
        assert len(tests) == 1, f"{len(tests)} tests run `{command}` of {page}"
        find_test(tests[0])


@pytest.mark.parametrize("text", ["```python\nimport sparring\n```\n", "```sh\npython examples/new.py\n```\n", "`python -m new`"])
def test_block_without_test_is_found(text, tmp_path, monkeypatch):
    monkeypatch.setattr(documents, "ROOT", tmp_path)
    (tmp_path / "new.md").write_text(text)
    assert pages() == ["new.md"]
    with pytest.raises(AssertionError, match=r"no test runs|0 tests run"):
        test_every_printed_block_has_a_test("new.md")


def test_list_of_tests_has_no_stale_entry():
    assert all(code_blocks(page) for page in CODE_TESTS)
    for page, start in COMMAND_TESTS:
        assert any(command.startswith(start) for command in commands(page)), f"{page} does not print `{start}`"


def install_lines():
    """Yields the arguments of each `pip install` in the documentation, the examples and the package's messages."""
    files = [*pages(), *(str(file.relative_to(ROOT)) for folder in ("examples", "python/sparring")
                         for file in (ROOT / folder).glob("**/*") if file.suffix in (".py", ".ipynb"))]  # fmt: skip
    for file in files:
        for found in PIP_INSTALL.findall(read_page(file)):
            yield file, shlex.split(found)


def test_pip_commands_install_known_packages():
    toml = pytest.importorskip("tomllib").loads
    extras = toml(read_page("python/pyproject.toml"))["project"]["optional-dependencies"]
    assert toml(read_page("python/server/pyproject.toml"))["project"]["name"] == "sparring-server"
    tested = " ".join(file.read_text() for file in (ROOT / "scripts").glob("*-venv"))
    count = 0
    for file, words in install_lines():
        for word in words:
            name, _, listed = word.rstrip("].,").partition("[")
            if name == "sparring":
                assert set(filter(None, listed.split(","))) <= extras.keys(), f"{file}: {word}"
            elif name not in ("sparring-server", "vllm", "--find-links", "target/wheels", "python/verifiers"):
                assert re.search(rf"[(\"\s]{re.escape(name)}[\[=<>\s\")]", tested), f"{file}: no test installs {name}"
            count += 1
    assert count > 20


@pytest.mark.parametrize("page", [page for page in pages() if code_blocks(page) or commands(page)])
def test_page_installs_what_its_code_needs(page):
    printed = "\n".join([*code_blocks(page), *(command for command in commands(page) if not command.startswith("pip "))])
    installed = " ".join(" ".join(words) for file, words in install_lines() if file == page)
    for feature, extra in EXTRAS_OF_FEATURES.items():
        if feature in printed and page != "docs/reference/strategies-measured.md":  # it refers to the guide
            assert re.search(rf"sparring\[(?:\w+,)*{extra}[,\]]", installed), f"{feature} needs sparring[{extra}]"
    if "Curriculum.local(" in printed or "--local" in printed:
        assert "sparring-server" in installed


def run_blocks(page, curriculum, names, replacements=None):
    """Runs all Python blocks of a page from top to bottom in one namespace; returns what they print."""
    code = "\n".join(code_blocks(page)).replace(URL, curriculum.url)
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(compile(replace_all(code, replacements or {}), page, "exec"), names)
    return output.getvalue()


@needs_server
def test_python_page_runs_from_top_to_bottom(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    pytest.importorskip("moviepy")
    pytest.importorskip("httpx")
    monkeypatch.chdir(tmp_path)
    with local_curriculum() as curriculum:
        names = {}
        run_blocks("docs/reference/python.md", curriculum, names)
    assert names["bracket"].skill(names["outcome"].score) > 0.0
    assert names["version"] == 999 and names["curriculum"].policy_version == 999
    assert names["event"].kind == "run"


@needs_server
def test_own_loop_page_runs_from_top_to_bottom():
    pytest.importorskip("httpx")
    with local_curriculum() as curriculum:
        names = {}
        run_blocks("docs/guides/train-own-loop.md", curriculum, names)
    assert names["version"] == 999
    assert len(names["reported"]) == len(names["results"]) >= 2
    assert {result["status"] for result in names["reported"]} == {"counted"}
    assert names["mastery"][0]["results"]["episodes"] == len(names["reported"])


@needs_server
def test_evaluation_code_runs():
    def act(observations):
        return np.zeros((len(observations), 3, 2), np.float32)

    with local_curriculum() as curriculum:
        names = {"sparring": sparring, "curriculum": curriculum, "act": act}
        output = run_blocks("docs/guides/evaluate.md", curriculum, names)
    assert re.fullmatch(r"eval-\S+ -?\d\.\d+\n", output), output


def test_package_readme_code_runs():
    names = {}
    exec("\n".join(code_blocks("python/README.md")), names)
    assert names["observations"].shape == (1024, 3, 72)


def masked(line):
    """Returns a line without numbers, ids and padding, which differ from run to run."""
    line = re.sub(r"(?:[-\w]*_)?\d+-[a-z0-9]{6}\w*", "#", line)
    return " ".join(re.sub(r"\b(?:True|False)\b", "#", re.sub(r"\d[-\d.:TZ]*", "#", line)).split())


@needs_server
def test_printed_examples_run(tmp_path):
    with local_curriculum() as curriculum:
        for page in ("docs/reference/feed.md", "docs/reference/trajectories.md"):
            for command in commands(page):
                script = shlex.split(command)[1].removeprefix("examples/")
                # feed_nats.py needs a NATS server, and has a test of its own.
                if command.startswith("pip ") or script == "feed_nats.py":
                    continue
                needs_packages = script in ("step.py", "vector.py") or "msgpack" in command
                if needs_packages and not OPENENV_PYTHON.exists():
                    continue
                # Smaller numbers than the recorded ones, so that the test takes seconds.
                more = {"groups.py": ["--rounds", "1"], "columns.py": ["--rounds", "1"], "vector.py": ["2"]}.get(script, [])
                words = command.replace(URL, curriculum.url)
                if script == "events.py":
                    words = replace_all(words, {"run-na9vymyq": latest_run(curriculum, "columns")})
                if URL not in command:
                    more = [*more, "--url", curriculum.url]
                python = {"python": OPENENV_PYTHON} if needs_packages else {}
                output = run_command(words, tmp_path, *more, **python)
                recorded = printed_output(page, command)[0]
                if "--forge" not in command:  # the forged scores decide which message the audit gives
                    assert masked(recorded) in map(masked, output.splitlines()), f"{command}\n{recorded}\n{output}"


def latest_run(curriculum, form):
    """Returns the id of the newest run with a lease of a form."""
    for run in curriculum.request("GET", "/v1/runs")["runs"]:
        leases = curriculum.request("GET", f"/v1/runs/{run['id']}/leases")["leases"]
        if any(lease["form"] == form for lease in leases):
            return run["id"]
    raise AssertionError(f"no run has a lease of {form}")


@needs_server
def test_readme_trainer_learns(tmp_path):
    """The commands of the README: an environment by scripts/venv, and the trainer beside a server."""
    program = code_blocks("README.md")[0]
    assert program == (ROOT / "examples/first_trainer.py").read_text(encoding="utf-8")
    assert sum(bool(line.strip()) for line in program.splitlines()) <= 20
    venv = tmp_path / "venv"
    # Python compiles the modules that it imports; pip would compile all of them.
    subprocess.run([ROOT / "scripts/venv", venv], check=True, env={**os.environ, "PIP_NO_COMPILE": "1"})
    assert (venv / "bin/sparring").resolve() == (ROOT / "target/debug/sparring").resolve()
    with local_curriculum() as curriculum:
        command = [venv / "bin/python", "-c", program.replace(URL, curriculum.url)]
        trainer = subprocess.run(command, check=True, capture_output=True, text=True)
    levels = [int(level) for level in re.findall(r"^update \d+ level (\d) skill", trainer.stdout, re.MULTILINE)]
    assert len(levels) == 8 and levels[0] <= 1 and levels[-1] >= 2, trainer.stdout


@needs_server
def test_readme_environments_run(tmp_path, monkeypatch):
    pytest.importorskip("pettingzoo")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SPARRING_BIN", BINARY)
    _, environments, curriculum = code_blocks("README.md")
    exec(environments, {})
    exec(curriculum, {})
    assert (tmp_path / "mine.sqlite3").stat().st_size > 0
