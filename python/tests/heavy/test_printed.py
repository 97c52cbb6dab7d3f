"""Code and commands of the guides to RLlib and TRL, as printed except for the size of the training. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_printed.py
"""

import contextlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import needs_server
from curriculum_servers import local_curriculum
from documents import ROOT, URL, blocks, code_blocks, printed_command, replace_all, run_command

pytest.importorskip("ray")
pytest.importorskip("trl")
import ray

sys.path.insert(0, os.fspath(ROOT / "examples"))
tiny_model = pytest.importorskip("tiny_model")

#: Options of a GRPO training of seconds.
SMALL = "--group-size 8 --groups 1 --tokens 512 --steps 1"


@pytest.fixture(scope="module")
def server_url():
    with local_curriculum() as curriculum:
        yield curriculum.url


def run_block(page, names, replacements, part=""):
    """Runs the only Python block of a page that contains `part`, with replaced parts."""
    (code,) = [code for code in code_blocks(page) if part in code]
    exec(compile(replace_all(code, replacements), page, "exec"), names)


@needs_server
def test_printed_algorithm_trains(server_url):
    ray.init("local", num_cpus=3, include_dashboard=False, object_store_memory=100 * 2**20, log_to_driver=False)
    names = {}
    try:
        run_block("docs/guides/train-rllib.md", names, {URL: server_url}, "PPOConfig()")
        result = names["algorithm"].train()
        names["algorithm"].stop()
        run_block("docs/guides/train-rllib.md", names, {"evaluation_interval=10": "evaluation_interval=1"}, "config.evaluation(")
        evaluated = names["algorithm"].train()
        names["algorithm"].stop()
    finally:
        ray.shutdown()
    assert "evaluation" not in result and evaluated["evaluation"]["env_runners"]["num_episodes"] >= 10
    assert result["curriculum"]["episodes/finished"] > 0
    assert result["env_runners"]["num_env_steps_sampled"] >= 2 * 32 * 50


def test_printed_scanning_command_trains_and_plots(tmp_path):
    shorter = {"--steps 2000000": "--steps 4096"}
    command = printed_command("docs/guides/train-rllib.md", "python examples/scanning_rllib.py", shorter)
    output = run_command(command, tmp_path, "--evaluations", "1", "--episodes", "4", "--envs", "16")
    evaluations = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    assert evaluations[0]["steps"] == 0 and evaluations[-1]["steps"] >= 4096
    assert all(0 <= row["survived"] <= 1 and -1 <= row["return"] <= 1 for row in evaluations)
    assert "<svg" in (tmp_path / "scanning.svg").read_text()


@needs_server
def test_printed_trainer_trains(server_url, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import sparring.trl

    model, tokenizer = tiny_model.make_tiny_model([sparring.trl.PROMPT])
    names = {"model": model, "tokenizer": tokenizer}
    smaller = {
        'model="Qwen/Qwen3-4B",': "model=model, processing_class=tokenizer,",
        "gradient_accumulation_steps=4, max_steps=500": "gradient_accumulation_steps=1, max_steps=1, use_cpu=True, bf16=False",
        "max_completion_length=8192": "max_completion_length=64",
    }
    first = "EnvironmentFactory(curriculum, group_size=8) as envs:\n    trainer = GRPOTrainer("
    run_block("docs/guides/train-trl.md", names, {URL: server_url, **smaller}, first)
    assert names["trainer"].state.global_step == 1
    assert names["curriculum"].mastery()[0]["results"]["episodes"] == 8
    names["curriculum"].close()
    for part in ("AsyncGRPOTrainer(", "sparring.trl.Environments("):
        run_other_trainer(server_url, tmp_path, part)


def run_other_trainer(server_url, tmp_path, part):
    """Runs another block of the guide to TRL, with a tiny model that answers without tools."""
    import tiny_generation_server

    import sparring.trl

    model, tokenizer = tiny_model.make_tiny_model([sparring.trl.PROMPT, sparring.trl.DOCKING_PROMPT])
    names = {"__name__": "__main__", "model": model, "tokenizer": tokenizer}
    small = "max_steps=1, use_cpu=True, bf16=False"
    smaller = {'model="Qwen/Qwen3-4B",': "model=model, processing_class=tokenizer,", "max_steps=500": small}
    with contextlib.ExitStack() as stack:
        if part == "AsyncGRPOTrainer(":
            tiny_generation_server.replace_gpu_parts()
            server = tiny_generation_server.GenerationServer(model, tokenizer)
            stack.callback(server.stop)
            names["model"] = os.fspath(tmp_path / "tiny")
            model.save_pretrained(names["model"])
            names["weights"] = tiny_generation_server.WeightCopy(server)
            smaller["max_steps=500"] = f'{small}, token_budget=0, max_inflight_tasks=8, vllm_server_base_url="{server.url}"'
            smaller['model="Qwen/Qwen3-4B",'] += " weight_transfer=weights,"
            smaller["max_completion_length=1024"] = "max_completion_length=8"
        else:
            smaller["max_completion_length=8192"] = "max_completion_length=64"
        run_block("docs/guides/train-trl.md", names, {URL: server_url, **smaller}, part)
        assert names["trainer"].state.global_step == 1
        curricula = [value for value in names.values() if isinstance(value, sparring.Curriculum)]
        assert sum(row["results"]["episodes"] for curriculum in curricula for row in curriculum.mastery()) >= 8
        for curriculum in curricula:
            curriculum.close()


@needs_server
def test_printed_gpu_commands_train(server_url, tmp_path):
    """Runs the block without its installation and server, and with a tiny model on the CPU in place of a large one in vLLM."""
    (block,) = [block.text for block in blocks("docs/guides/train-trl.md") if "torchrun" in block.text]
    script = replace_all(
        block,
        {
            "pip install 'sparring[trl]' 'trl[vllm]' sparring-server\n": "",
            "sparring serve --db training.sqlite3 &\n": "",
            URL: server_url,
            "--model Qwen/Qwen3-4B --lora --vllm": "--tiny --lora",
            "--group-size 8 --groups 4 --tokens 8192 --steps 500": SMALL,
            "--group-size 8 --groups 2 --tokens 8192 --steps 500": SMALL,
        },
    )
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    path = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": os.fspath(ROOT / "python")}
    environment = {**os.environ, **path, "OMP_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    command = ["bash", "-ec", script]
    ended = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=600)
    assert ended.returncode == 0, ended.stderr[-3000:]
    finished = re.findall(r"^(run-\w+): 8 episodes finished, 8 counted$", ended.stdout, re.MULTILINE)
    assert len(finished) == 3 and len(set(finished)) == 2, ended.stdout


@needs_server
def test_printed_openenv_command_trains(server_url, tmp_path):
    import grpo_openenv

    folder = tmp_path / "qwen2.5-coder-1.5b-instruct"
    for part in tiny_model.make_tiny_model([grpo_openenv.PROMPT]):
        part.save_pretrained(folder)
    command = printed_command("docs/reference/openenv.md", "python examples/grpo_openenv.py")
    output = run_command(command, tmp_path, "--url", server_url)
    assert re.search(r"^run-\w+: 2 episodes were reported, mean score \d", output, re.MULTILINE), output
