"""Cities in the order of the basic World Cities Database of simplemaps.com (CC BY 4.0)."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files


@dataclass(frozen=True)
class City:
    """City: name with the code of its country, latitude and longitude in degrees."""

    name: str
    latitude_deg: float
    longitude_deg: float


@lru_cache(maxsize=1)
def cities() -> tuple[City, ...]:
    """Returns all cities of the list, in its order: the largest first."""
    content = files(__package__).joinpath("cities.tsv.gz").read_bytes()
    lines = gzip.decompress(content).decode().splitlines()
    rows = (line.split("\t") for line in lines)
    return tuple(City(name, float(lat), float(lng)) for lat, lng, name in rows)
