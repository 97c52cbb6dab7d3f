"""The task kessler/survival in plain Python, as a reference for ports. Trainers should use the package `sparring` instead.

It follows docs/worlds/kessler.md only: the same recipe and seed give the same scenario, and the arithmetic is the same, so that the
server's replay gives the same score. It is slow (about 2 ms a step with 25 pieces of debris), and supports only the default
physics options.
"""

import math
import struct

# Gravitational parameter in LU^3/TU^2, radius of the Earth and contact distance in LU, steps of an episode.
GM, EARTH, CONTACT, HORIZON = 1000.0, 20.0, 2.0, 50
TAU = 2 * math.pi
DEFAULT_PHYSICS = {
    "compat": "none",
    "contact": "end_of_step",
    "gravity": "point",
    "risk": "contact",
    "start": "fair",
    "warnings": "none",
}
# Purposes of random streams.
AGENTS, BODIES, REDRAW, FRAGMENTS = 0, 1, 2, 5
# Attempts to draw a piece of debris that makes the start fair.
MAX_REDRAWS = 65


class KeyedRng:
    """ChaCha8 keyed by seed and purpose. A draw is the top 53 bits of two words, uniform in [0, 1)."""

    def __init__(self, seed, purpose, number=0):
        key = struct.pack("<QQ16s", seed, purpose, b"sparring chance1")
        constants, words = struct.unpack("<4I", b"expand 32-byte k"), struct.unpack("<8I", key)
        self.state = [*constants, *words, 0, 0, number & 0xFFFFFFFF, number >> 32]
        self.words = []

    def uniform(self):
        """Draws a number in [0, 1)."""
        if not self.words:
            self.words = self.block()[::-1]
            self.state[12] += 1
        low, high = self.words.pop(), self.words.pop()
        return ((high << 32 | low) >> 11) * 2.0**-53

    def between(self, low, high):
        """Draws a number in [low, high)."""
        return low + (high - low) * self.uniform()

    def block(self):
        """Computes the next 16 words."""
        x = list(self.state)
        quarters = [(i, i + 4, i + 8, i + 12) for i in range(4)]
        quarters += [(i, 4 + (i + 1) % 4, 8 + (i + 2) % 4, 12 + (i + 3) % 4) for i in range(4)]

        def rotate(word, bits):
            return (word << bits | word >> (32 - bits)) & 0xFFFFFFFF

        for _ in range(4):
            for a, b, c, d in quarters:
                for left, right in ((16, 12), (8, 7)):
                    x[a] = (x[a] + x[b]) & 0xFFFFFFFF
                    x[d] = rotate(x[d] ^ x[a], left)
                    x[c] = (x[c] + x[d]) & 0xFFFFFFFF
                    x[b] = rotate(x[b] ^ x[c], right)
        return [(word + initial) & 0xFFFFFFFF for word, initial in zip(x, self.state)]


def circular_orbit(radius, angle):
    """Returns x, y, vx, vy on a circular orbit."""
    speed = math.sqrt(GM / radius)
    sin, cos = math.sin(angle), math.cos(angle)
    return [radius * cos, radius * sin, -speed * sin, speed * cos]


def coast(body):
    """Returns a body after one step of free flight: v += a(p); p += v."""
    r2 = body[0] * body[0] + body[1] * body[1]
    k = GM / (r2 * math.sqrt(r2))
    vx, vy = body[2] - k * body[0], body[3] - k * body[1]
    return [body[0] + vx, body[1] + vy, vx, vy]


def inside_earth(body):
    """Returns True if a body is inside the Earth."""
    return body[0] * body[0] + body[1] * body[1] < EARTH * EARTH


def in_contact(a, b):
    """Returns True if two bodies are in contact."""
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 < CONTACT * CONTACT


class Survival:
    """An episode of the scenario of a recipe and a seed."""

    def __init__(self, recipe, seed):
        params = recipe["params"]
        supported = recipe["physics"] == DEFAULT_PHYSICS and not recipe["layout"] and not params["rogue_probability"]
        if recipe["task"] != "kessler/survival" or not supported:
            raise ValueError(f"rogues, layouts, physics options and other tasks are not supported: {recipe}")
        self.fuel, self.step_number, self.total = [params["fuel"]] * 3, 0, 0.0
        agents, bodies, self.kicks = KeyedRng(seed, AGENTS), KeyedRng(seed, BODIES), KeyedRng(seed, FRAGMENTS)
        self.satellites = [circular_orbit(agents.between(50.0, 80.0), TAU * agents.uniform()) for _ in range(3)]
        self.active = [True] * 3
        self.debris = [self._draw_debris(bodies, params["spread"]) for _ in range(int(params["debris"]))]
        self._make_fair(seed, params["spread"])

    @staticmethod
    def _draw_debris(rng, spread):
        body = circular_orbit(rng.between(40.0, 90.0), TAU * rng.uniform())
        return [*body[:2], body[2] + rng.between(-1.0, 1.0) * spread, body[3] + rng.between(-1.0, 1.0) * spread]

    def _make_fair(self, seed, spread):
        """Redraws debris that touches a holding satellite before step 3, from a stream of its own."""
        paths = [self.satellites]
        for _ in range(2):
            paths.append([coast(body) for body in paths[-1]])
        for index, body in enumerate(self.debris):
            rng = KeyedRng(seed, REDRAW, index)
            for _ in range(MAX_REDRAWS):
                at, has_contact = body, False
                for step, satellites in enumerate(paths):
                    at = coast(at) if step else at
                    has_contact = has_contact or any(in_contact(satellite, at) for satellite in satellites)
                if not has_contact:
                    break
                body = self._draw_debris(rng, spread)
            else:
                raise ValueError("this scenario has no fair start")
            self.debris[index] = body

    @property
    def done(self):
        """True if the episode is over."""
        return self.step_number == HORIZON or not any(self.active)

    @property
    def score(self):
        """Score so far: the sum of rewards, clipped to the range of the task."""
        return min(max(self.total, 0.001), 0.999)

    def step(self, burns):
        """Runs one step; returns the reward.

        `burns` has [satellite, dvx, dvy], at most one per satellite.
        """
        self.step_number += 1
        for satellite, dvx, dvy in burns:
            dvx, dvy = min(max(dvx, -1.0), 1.0), min(max(dvy, -1.0), 1.0)
            cost = 5.0 * math.sqrt(dvx * dvx + dvy * dvy)
            if self.active[satellite] and cost <= self.fuel[satellite]:
                self.fuel[satellite] -= cost
                self.satellites[satellite][2] += dvx
                self.satellites[satellite][3] += dvy
        for i, body in enumerate(self.satellites):
            if self.active[i] and inside_earth(body):
                self.active[i] = False
            elif self.active[i]:
                self.satellites[i] = coast(body)
        self.debris = [coast(body) for body in self.debris if not inside_earth(body)]
        for i, body in enumerate(self.satellites):
            if self.active[i] and any(in_contact(body, debris) for debris in self.debris):
                self.active[i] = False
                for _ in range(2):
                    kick = [self.kicks.between(-1.0, 1.0) for _ in range(2)]
                    self.debris.append([body[0], body[1], body[2] + kick[0], body[3] + kick[1]])
        reward = sum(self.active) / 3 * (1 - 2 * 0.001) / HORIZON
        self.total += reward
        return reward
