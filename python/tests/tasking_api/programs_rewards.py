"""Programs that share data and pay rewards."""

from __future__ import annotations

import numpy as np
from parts import SCANNER_ARGS, Imager, Scanner, constellation, fly, imagers, images, train
from peer import (
    ConstellationTasking,
    Data,
    DataStore,
    GeneralSatelliteTasking,
    GlobalReward,
    SatelliteTasking,
    act,
    comm,
    data,
    dyn,
    fsw,
    obs,
    sats,
    scene,
)


def free_communication(seed):
    return fly(constellation(ConstellationTasking, imagers(3), comm.FreeCommunication()), seed, 15, images)


def communication_in_three_planes(seed):
    env = constellation(ConstellationTasking, imagers(6), comm.LOSMultiCommunication(), sat_arg_randomizer=train(planes=3))
    return fly(env, seed, 15, images)


def communication_with_a_period(seed):
    env = constellation(
        GeneralSatelliteTasking,
        imagers(3),
        comm.FreeCommunication(min_period=300.0),
        targets=(400, 1000),
        sat_arg_randomizer=train(10.0),
        time_limit=lambda: np.random.uniform(600.0, 1200.0),
        generate_obs_retasking_only=True,
    )
    return fly(env, seed, 40, images)


def broadcasts(seed):
    class Broadcaster(sats.ImagingSatellite):
        observation_spec = Imager.observation_spec
        action_spec = [act.Image(n_ahead_image=4), act.Broadcast(duration=30.0)]
        dyn_type = dyn.FullFeaturedDynModel
        fsw_type = fsw.SteeringImagerFSWModel

    class Communication(comm.BroadcastCommunication, comm.LOSCommunication):
        pass

    env = constellation(ConstellationTasking, imagers(3, Broadcaster), Communication(), sat_arg_randomizer=train(20.0))
    return fly(env, seed, 20, images)


def chains_of_free_communication(seed):
    class Communication(comm.MultiDegreeCommunication, comm.FreeCommunication):
        pass

    return fly(constellation(GeneralSatelliteTasking, imagers(2), Communication()), seed, 8, images)


def reward_functions(seed):
    weighted = data.ResourceReward(
        reward_weight=lambda: np.random.uniform(0.0, 1.0), resource_fn=lambda item: item.dynamics.battery_charge_fraction
    )
    rewarders = (data.UniqueImageReward(lambda priority: priority**2), weighted, data.NoReward())

    class Weighing(sats.ImagingSatellite):
        observation_spec = [*Imager.observation_spec, obs.ResourceRewardWeight(norm=0.5)]
        action_spec = Imager.action_spec
        dyn_type = dyn.FullFeaturedDynModel
        fsw_type = fsw.SteeringImagerFSWModel

    env = constellation(GeneralSatelliteTasking, imagers(2, Weighing), comm.FreeCommunication(), rewarder=rewarders)
    return fly(env, seed, 12, lambda env: [env.rewarder.cum_reward, env.reward_dict])


class Spin(Data):
    def __init__(self, change=0.0):
        self.change = change

    def __add__(self, other):
        return Spin(self.change + other.change)


class SpinStore(DataStore):
    data_type = Spin

    def get_log_state(self):
        return np.linalg.norm(self.satellite.dynamics.wheel_speeds)

    def compare_log_states(self, old_state, new_state):
        return Spin(new_state - old_state)


class SpinReward(GlobalReward):
    data_store_type = SpinStore

    def calculate_reward(self, new_data_dict):
        return {name: item.change for name, item in new_data_dict.items()}

    def is_terminated(self, satellite):
        return satellite.data_store.data.change < -60.0

    def is_truncated(self, satellite):
        return satellite.data_store.data.change > 40.0


def own_rewarder(seed):
    return fly(constellation(ConstellationTasking, imagers(2), rewarder=SpinReward()), seed, 12)


def scanning_reward_function(seed):
    env = SatelliteTasking(
        Scanner("S", SCANNER_ARGS, obs_type=dict),
        scenario=scene.UniformNadirScanning(),
        rewarder=data.ScanningTimeReward(lambda time: time**0.5),
        time_limit=4000.0,
        terminate_on_time_limit=True,
        log_level="CRITICAL",
    )
    return fly(env, seed, 60)


PROGRAMS = [
    free_communication,
    communication_in_three_planes,
    communication_with_a_period,
    broadcasts,
    chains_of_free_communication,
    reward_functions,
    own_rewarder,
    scanning_reward_function,
]
