"""Programs whose targets change, move, hide or are known to some satellites only."""

from __future__ import annotations

import numpy as np
from parts import Imager, constellation, fly, imagers, images
from peer import (
    ConstellationTasking,
    GeneralSatelliteTasking,
    Target,
    UniqueImageData,
    UniqueImageReward,
    UniqueImageStore,
    act,
    comm,
    dyn,
    fsw,
    obs,
    sats,
    scene,
)


class Fading(scene.UniformTargets):
    """Targets whose priorities change after each step."""

    def after_step(self, sim_time):
        for target in self.targets[::3]:
            target.priority = (sim_time % 100.0) / 100.0


def priorities_that_change(seed):
    env = constellation(GeneralSatelliteTasking, imagers(2), comm.FreeCommunication(), scenario=Fading(800))
    return fly(env, seed, 8, images)


class Divided(scene.UniformTargets):
    """Targets of which each satellite knows two thirds."""

    def reset_pre_sim_init(self):
        self.n_targets = self._n_targets
        self.regenerate_targets()
        for index, satellite in enumerate(self.satellites):
            for number, target in enumerate(self.targets):
                if number % 3 != index % 3:
                    satellite.add_location_for_access_checking(
                        object=target,
                        r_LP_P=target.r_LP_P,
                        min_elev=satellite.sat_args_generator["imageTargetMinimumElevation"],
                        type="target",
                    )


def coming(env):
    """Returns the next opportunities of each satellite, and the numbers of all of them."""
    found = {}
    for item in env.satellites:
        windows = [[entry["object"].name, *entry["window"]] for entry in item.find_next_opportunities(4, types="target")]
        counts = [len(item.opportunities), len(item.upcoming_opportunities), len(item.opportunities_dict(types="target"))]
        found[item.name] = [windows, counts]
    return [images(env), found]


def targets_of_some_satellites(seed):
    env = constellation(ConstellationTasking, imagers(3), comm.FreeCommunication(), scenario=Divided(900))
    return fly(env, seed, 8, coming)


class Turned(scene.UniformTargets):
    """Targets that are placed when the simulation has started, before the search for windows."""

    def reset_post_sim_init(self):
        rotation = self.satellites[0].dynamics.world.PN
        for target in self.targets[::2]:
            target.r_LP_P[:] = rotation @ np.array([target.r_LP_P[1], -target.r_LP_P[0], target.r_LP_P[2]])
        self.targets[1].priority = 0.77


def targets_placed_after_the_start(seed):
    return fly(constellation(GeneralSatelliteTasking, imagers(2), scenario=Turned(900)), seed, 6, coming)


class Wave(Target):
    """Target whose priority is computed."""

    @property
    def priority(self):
        return 0.5 + 0.5 * np.sin(self.phase)

    @priority.setter
    def priority(self, value):
        self.phase = value


class Waves(scene.UniformTargets):
    def regenerate_targets(self):
        super().regenerate_targets()
        self.targets = [Wave(target.name, target.r_LP_P, 9.0 * target.priority) for target in self.targets]


def targets_of_a_subclass(seed):
    return fly(constellation(GeneralSatelliteTasking, imagers(2), scenario=Waves(800)), seed, 5, images)


def targets_that_are_hidden(seed):
    env = constellation(GeneralSatelliteTasking, imagers(1))
    env.reset(seed=seed)
    satellite = env.satellites[0]
    satellite.hidden = set()
    satellite.add_access_filter(lambda item: item["object"] not in satellite.hidden)
    rng = np.random.default_rng(seed)
    records = []
    for _ in range(5):
        satellite.hidden = {target for target in env.scenario.targets if rng.random() < 0.5}
        before = satellite.get_obs()
        satellite.observation_builder.obs_dict_cache = None
        records.append([before, satellite.get_obs(), env.step([int(rng.integers(4))])])
    return records


class CloudData(UniqueImageData):
    def __init__(self, imaged=None, duplicates=0, known=None, clear=None):
        super().__init__(imaged=imaged, duplicates=duplicates, known=known)
        self.clear = set(clear or ())

    def __add__(self, other):
        total = super().__add__(other)
        return CloudData(total.imaged, total.duplicates, total.known, self.clear | other.clear)


class CloudStore(UniqueImageStore):
    data_type = CloudData

    def compare_log_states(self, old_state, new_state):
        if new_state - old_state <= 0:
            return CloudData()
        target = self.satellite.latest_target
        self.update_target_colors([target])
        return CloudData(imaged={target}, clear=[target] if target.cloud < 0.5 else [])


class CloudReward(UniqueImageReward):
    data_store_type = CloudStore

    def calculate_reward(self, new_data_dict):
        return {name: sum(item.priority for item in data.clear) for name, data in new_data_dict.items()}


class Clouds(scene.UniformTargets):
    def regenerate_targets(self):
        super().regenerate_targets()
        for target in self.targets:
            target.cloud = np.random.uniform()


def rewarder_of_clear_images(seed):
    env = constellation(
        GeneralSatelliteTasking, imagers(2), comm.FreeCommunication(), scenario=Clouds(800), rewarder=CloudReward()
    )
    return [*fly(env, seed, 8, images), sorted(item.name for item in env.rewarder.data.clear)]


def types_of_results(seed):
    """Returns the names of the types, which programs print."""
    env = constellation(GeneralSatelliteTasking, imagers(1, obs_type=dict), time_limit=900.0, max_step_duration=300.0)
    observation, info = env.reset(seed=seed)
    records = []
    while True:
        first = observation[0]["target"]["target_0"]
        windows = env.satellites[0].find_next_opportunities(6, types="target")
        numbers = [*first.values(), *[time for item in windows for time in item["window"]], env.time_limit]
        records.append([type(number).__name__ for number in numbers])
        observation, reward, terminated, truncated, info = env.step([0])
        records.append([type(item).__name__ for item in (reward, terminated, truncated, info["d_ts"])])
        if truncated:
            return records


def actions_in_lists(seed):
    env = constellation(ConstellationTasking, imagers(2), max_step_duration=40.0)
    env.reset(seed=seed)
    return [env.step({"EO_1": [1], "EO_2": (2,)}), env.step({"EO_1": np.array([3])}), env.step({"EO_2": [2**31 - 1]})]


class Watcher(sats.ImagingSatellite):
    """Satellite that observes how much it could image in times to come."""

    class Density(obs.Observation):
        def get_obs(self):
            satellite, now = self.satellite, self.simulator.sim_time
            satellite.calculate_additional_windows(now + 1500.0 - satellite.window_calculation_time)
            windows = satellite.upcoming_opportunities_dict(types="target")
            closes = np.array([times[0][1] for times in windows.values()])
            return np.histogram(closes, bins=now + np.arange(0.0, 1500.0, 300.0))[0] / 5.0

    observation_spec = [Density("density"), *Imager.observation_spec]
    action_spec = [act.Image(n_ahead_image=4)]
    dyn_type = dyn.FullFeaturedDynModel
    fsw_type = fsw.SteeringImagerFSWModel


def windows_computed_ahead(seed):
    return fly(constellation(GeneralSatelliteTasking, imagers(1, Watcher)), seed, 6)


def windows_of_many_blocks(seed):
    """Computes windows of several blocks in one search."""
    found = []
    for episode in range(seed, seed + 8):
        env = constellation(GeneralSatelliteTasking, imagers(1), targets=300)
        env.reset(seed=episode)
        satellite = env.satellites[0]
        satellite.calculate_additional_windows(12000.0)
        found.append([[str(item["object"]), *item["window"]] for item in satellite.opportunities])
    return found


def storage_with_a_negative_level(seed):
    env = constellation(GeneralSatelliteTasking, imagers(1, storageInit=-1))
    env.reset(seed=seed)
    return [env.satellites[0].dynamics.storage_level, env.step([0]), env.satellites[0].dynamics.storage_level]


PROGRAMS = [
    priorities_that_change,
    targets_of_some_satellites,
    targets_placed_after_the_start,
    targets_of_a_subclass,
    targets_that_are_hidden,
    rewarder_of_clear_images,
    types_of_results,
    actions_in_lists,
    windows_computed_ahead,
    windows_of_many_blocks,
    storage_with_a_negative_level,
]
