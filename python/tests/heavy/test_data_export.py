"""Exported tables and SQL views, as pandas, polars and DuckDB read them. Run by hand:

    scripts/heavy-venv
    cd python && SPARRING_BINARY=../target/debug/sparring PYTHONPATH=. ../target/heavy-venv/bin/pytest -o addopts= \
        -o filterwarnings=default -p no:cacheprovider tests/heavy/test_data_export.py
"""

import shlex
import subprocess

import pytest
from conftest import BINARY, needs_server
from curriculum_servers import local_curriculum, step_randomly
from documents import blocks, code_blocks

pytest.importorskip("duckdb")
pytest.importorskip("polars")
pytest.importorskip("pyarrow")
import duckdb
import pandas
import polars

import sparring

pytestmark = needs_server
PAGE = "docs/reference/data.md"
TABLES = ("runs", "moves", "layouts", "claims", "groups", "episodes", "mastery", "trainer_metrics")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Makes a database with episodes and metrics, and exports it by the printed command."""
    folder = tmp_path_factory.mktemp("data")
    with local_curriculum(db=folder / "sparring.sqlite3") as curriculum:
        envs = sparring.make_vec(num_envs=4, curriculum=curriculum)
        envs.reset()
        step_randomly(envs, 120)
        curriculum.log_metrics(10, {"train/loss": 0.5, "train/kl": float("nan")})
        envs.close()
        curriculum.flush()
    [command] = [block.text.strip() for block in blocks(PAGE) if block.language == "sh"]
    words = shlex.split(command)
    assert words[0] == "sparring"
    subprocess.run([BINARY, *words[1:]], cwd=folder, check=True, capture_output=True)
    return folder


def test_printed_code_reads_the_tables(folder, monkeypatch):
    monkeypatch.chdir(folder)
    names = {}
    exec("\n".join(code_blocks(PAGE)), names)
    episodes, mastery, moves = names["episodes"], names["mastery"], names["moves"]
    assert len(episodes) >= 4 and str(episodes["at"].dtype).startswith("datetime64[ms, UTC")
    assert episodes["score"].between(0, 1).all() and episodes["success"].dtype == bool
    assert mastery["seconds"].to_list() == [60] * len(mastery) and mastery["episodes"].sum() == len(episodes)
    assert list(moves.columns) == ["at", "task", "to_level"]


def test_all_libraries_read_equal_tables(folder):
    for table in TABLES:
        file = folder / "tables" / f"{table}.parquet"
        by_pandas, by_polars = pandas.read_parquet(file), polars.read_parquet(file)
        [(count,)] = duckdb.sql(f"SELECT count(*) FROM '{file}'").fetchall()
        assert len(by_pandas) == len(by_polars) == count
        assert list(by_pandas.columns) == by_polars.columns
    metrics = polars.read_parquet(folder / "tables" / "trainer_metrics.parquet").sort("name")
    assert metrics.select("name", "step", "value").rows() == [("train/kl", 10, None), ("train/loss", 10, 0.5)]
