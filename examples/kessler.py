"""kessler/survival in plain Python: the world in a trainer's own process, for those that port it. Who trains in Python imports the
compiled one instead: pip install sparring, docs/python.md.

Made of nothing but what docs/kessler.md says: the same scenario from the same recipe and seed, the same arithmetic, so that what
is claimed of an episode replays. Slow (about 2 ms a step with 25 pieces of debris); options of physics other than the defaults are
refused.
"""
import math
import struct

GM, EARTH, CONTACT, HORIZON, TAU = 1000.0, 20.0, 2.0, 50, 2 * math.pi
PLAIN = {"compat": "none", "contact": "end_of_step", "gravity": "point", "risk": "contact", "start": "fair", "warnings": "none"}
AGENTS, BODIES, REDRAW, FRAGMENTS = 0, 1, 2, 5  # streams of draws, by purpose


class Draws:
    """ChaCha8 keyed by (seed, purpose): uniform in [0, 1), the top 53 bits of every two words."""

    def __init__(self, seed, purpose, number=0):
        key = struct.pack("<QQ16s", seed, purpose, b"sparring chance1")
        self.start = [*struct.unpack("<4I", b"expand 32-byte k"), *struct.unpack("<8I", key), 0, 0, number & 0xFFFFFFFF, number >> 32]
        self.words = []

    def uniform(self):
        if not self.words:
            self.words = self.block()[::-1]
            self.start[12] += 1
        low, high = self.words.pop(), self.words.pop()
        return ((high << 32 | low) >> 11) * 2.0**-53

    def between(self, low, high):
        return low + (high - low) * self.uniform()

    def block(self):
        x = list(self.start)
        quarters = [(i, i + 4, i + 8, i + 12) for i in range(4)]
        quarters += [(i, 4 + (i + 1) % 4, 8 + (i + 2) % 4, 12 + (i + 3) % 4) for i in range(4)]
        turn = lambda word, bits: (word << bits | word >> (32 - bits)) & 0xFFFFFFFF
        for _ in range(4):
            for a, b, c, d in quarters:
                for left, right in ((16, 12), (8, 7)):
                    x[a] = (x[a] + x[b]) & 0xFFFFFFFF
                    x[d] = turn(x[d] ^ x[a], left)
                    x[c] = (x[c] + x[d]) & 0xFFFFFFFF
                    x[b] = turn(x[b] ^ x[c], right)
        return [(word + begin) & 0xFFFFFFFF for word, begin in zip(x, self.start)]


def circular(radius, angle):
    speed = math.sqrt(GM / radius)
    sin, cos = math.sin(angle), math.cos(angle)
    return [radius * cos, radius * sin, -speed * sin, speed * cos]


def coast(body):
    """One step of free flight: v += a(p); p += v."""
    r2 = body[0] * body[0] + body[1] * body[1]
    k = GM / (r2 * math.sqrt(r2))
    vx, vy = body[2] - k * body[0], body[3] - k * body[1]
    return [body[0] + vx, body[1] + vy, vx, vy]


def touch(a, b):
    return (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 < CONTACT * CONTACT


class Survival:
    """One episode of a recipe and a seed."""

    def __init__(self, recipe, seed):
        params = recipe["params"]
        plain = recipe["physics"] == PLAIN and not recipe["layout"] and not params["rogue_probability"]
        if recipe["task"] != "kessler/survival" or not plain:
            raise ValueError(f"this flies kessler/survival as it comes, and no {recipe['task']} with rogues, a layout or other physics")
        self.fuel, self.step_number, self.total = [params["fuel"]] * 3, 0, 0.0
        agents, bodies, self.kicks = Draws(seed, AGENTS), Draws(seed, BODIES), Draws(seed, FRAGMENTS)
        self.satellites = [circular(agents.between(50.0, 80.0), TAU * agents.uniform()) for _ in range(3)]
        self.active = [True] * 3
        self.debris = [self._drawn(bodies, params["spread"]) for _ in range(int(params["debris"]))]
        self._make_fair(seed, params["spread"])

    @staticmethod
    def _drawn(draws, spread):
        body = circular(draws.between(40.0, 90.0), TAU * draws.uniform())
        return [*body[:2], body[2] + draws.between(-1.0, 1.0) * spread, body[3] + draws.between(-1.0, 1.0) * spread]

    def _make_fair(self, seed, spread):
        """What touches a satellite before step 3 under hold is drawn again, from a stream of its own."""
        paths = [self.satellites]
        for _ in range(2):
            paths.append([coast(body) for body in paths[-1]])
        for index, body in enumerate(self.debris):
            draws = Draws(seed, REDRAW, index)
            for _ in range(65):
                at, touches = body, False
                for step, satellites in enumerate(paths):
                    at = coast(at) if step else at
                    touches = touches or any(touch(satellite, at) for satellite in satellites)
                if not touches:
                    break
                body = self._drawn(draws, spread)
            else:
                raise ValueError("this scenario has no fair start")
            self.debris[index] = body

    @property
    def done(self):
        return self.step_number == HORIZON or not any(self.active)

    @property
    def score(self):
        return min(max(self.total, 0.001), 0.999)

    def step(self, burns):
        """`burns`: [satellite, dvx, dvy], at most one for each. The reward."""
        self.step_number += 1
        for satellite, dvx, dvy in burns:
            dvx, dvy = min(max(dvx, -1.0), 1.0), min(max(dvy, -1.0), 1.0)
            cost = 5.0 * math.sqrt(dvx * dvx + dvy * dvy)
            if self.active[satellite] and cost <= self.fuel[satellite]:
                self.fuel[satellite] -= cost
                self.satellites[satellite][2] += dvx
                self.satellites[satellite][3] += dvy
        inside = lambda body: body[0] * body[0] + body[1] * body[1] < EARTH * EARTH
        for i, body in enumerate(self.satellites):
            if self.active[i] and inside(body):
                self.active[i] = False
            elif self.active[i]:
                self.satellites[i] = coast(body)
        self.debris = [coast(body) for body in self.debris if not inside(body)]
        for i, body in enumerate(self.satellites):
            if self.active[i] and any(touch(body, debris) for debris in self.debris):
                self.active[i] = False
                for _ in range(2):
                    kick = [self.kicks.between(-1.0, 1.0) for _ in range(2)]
                    self.debris.append([body[0], body[1], body[2] + kick[0], body[3] + kick[1]])
        reward = sum(self.active) / 3 * (1 - 2 * 0.001) / HORIZON
        self.total += reward
        return reward
