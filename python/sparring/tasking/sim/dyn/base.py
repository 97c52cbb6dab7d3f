"""State of a satellite: orbit and attitude, as properties of its dynamics model."""

from __future__ import annotations

from abc import ABC
from collections.abc import Iterable
from typing import Any

import numpy as np

from ...messaging import Message, SCStatesMsgPayload
from ...utils.attitude import random_tumble
from ...utils.elements import MU_EARTH, REQ_EARTH, Vector, elem2rv
from ...utils.functional import (
    Resetable,
    aliveness_checker,
    check_aliveness_checkers,
    default_args,
)
from ...utils.orbital import random_orbit
from .. import world
from ..parameters import FixedAttribute, Parameters

#: Largest rate of the random tumble at the start, rad/s.
_MAX_TUMBLE = 0.0001


def _random_attitude() -> Vector:
    """Draws a tumble, and returns its attitude (MRP)."""
    return random_tumble(maxSpinRate=_MAX_TUMBLE)[0]


def _random_rate() -> Vector:
    """Draws a tumble, and returns its body rate, rad/s."""
    return random_tumble(maxSpinRate=_MAX_TUMBLE)[1]


class DynamicsModelABC(ABC, Resetable):
    """Base of the dynamics models of a satellite."""

    @classmethod
    def _requires_world(cls) -> list[type]:
        """World models that the model needs."""
        return []

    def __init__(self, satellite: Any, dyn_rate: float, priority: int = 200, **kwargs: Any) -> None:
        self.satellite = satellite
        self.logger = satellite.logger.getChild(type(self).__name__)
        #: Run of the simulation in which a message of this model was written last.
        self.written_run = -1
        for required in self._requires_world():
            if not isinstance(self.simulator.world, required):
                raise TypeError(
                    f"{self.simulator.world} must be a subclass of {required} to use dynamics model of type {type(self)}"
                )
        self.dyn_rate = dyn_rate
        self._setup_dynamics_objects(**kwargs)

    @property
    def simulator(self) -> Any:
        """Simulator of the episode."""
        return self.satellite.simulator

    @property
    def world(self) -> Any:
        """World model of the episode."""
        return self.satellite.simulator.world

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        """Sets up the objects of the model."""

    def is_alive(self, log_failure: bool = False) -> bool:
        """Returns whether all aliveness checkers of the model pass."""
        return check_aliveness_checkers(self, log_failure=log_failure)

    def reset_for_action(self) -> None:
        """Hook of BSK-RL's actions; the simulation resets its models itself."""

    @default_args(utc_init="this value will be set by the world model")
    def _utc_init(self, utc_init: str) -> None:
        """Names the epoch as an argument of satellites."""

    @property
    def is_overwritten(self) -> bool:
        """Whether a message of the model was written since the last run of the simulation."""
        return bool(self.written_run == self.satellite.simulator.run_count)

    def native_value(self, name: str) -> list[float]:
        """Returns the numbers of a property from the simulation."""
        satellite = self.satellite
        value: list[float] = satellite.simulator.native.value(satellite.index, name)
        return value

    def native_number(self, name: str) -> float:
        """Returns the number of a property from the simulation."""
        return self.native_value(name)[0]


class DynamicsModel(DynamicsModelABC):
    """Orbit and attitude of a satellite."""

    min_orbital_radius = FixedAttribute()

    @property
    def sigma_BN(self) -> list[float]:
        """MRP of the body relative to the inertial frame."""
        return self.native_value("sigma_BN")

    @property
    def BN(self) -> Vector:
        """Rotation from the inertial frame to the body."""
        return np.array(self.native_value("BN")).reshape((3, 3))

    @property
    def omega_BN_B(self) -> list[float]:
        """Angular velocity of the body in body axes, rad/s."""
        return self.native_value("omega_BN_B")

    @property
    def BP(self) -> Vector:
        """Rotation from the planet-fixed frame to the body."""
        return np.array(self.native_value("BP")).reshape((3, 3))

    @property
    def HN(self) -> Vector:
        """Rotation from the inertial frame to the Hill frame."""
        return np.array(self.native_value("HN")).reshape((3, 3))

    @property
    def r_BN_N(self) -> list[float]:
        """Position in the inertial frame, m."""
        return self.native_value("r_BN_N")

    @property
    def r_BN_P(self) -> Vector:
        """Position in the planet-fixed frame, m."""
        return np.array(self.native_value("r_BN_P"))

    @property
    def v_BN_N(self) -> list[float]:
        """Velocity in the inertial frame, m/s."""
        return self.native_value("v_BN_N")

    @property
    def v_BN_P(self) -> Vector:
        """Velocity relative to the planet in the planet-fixed frame, m/s."""
        return np.array(self.native_value("v_BN_P"))

    @property
    def omega_BP_P(self) -> Vector:
        """Angular velocity relative to the planet in the planet-fixed frame, rad/s."""
        return np.array(self.native_value("omega_BP_P"))

    @property
    def omega_BH_H(self) -> Vector:
        """Angular velocity relative to the Hill frame in that frame, rad/s."""
        return np.array(self.native_value("omega_BH_H"))

    @property
    def semi_major_axis(self) -> float:
        """Semi-major axis at the first reading, m."""
        return self.native_number("semi_major_axis")

    @property
    def eccentricity(self) -> float:
        """Eccentricity at the first reading."""
        return self.native_number("eccentricity")

    @property
    def inclination(self) -> float:
        """Inclination at the first reading, rad."""
        return self.native_number("inclination")

    @property
    def ascending_node(self) -> float:
        """Right ascension of the ascending node at the first reading, rad."""
        return self.native_number("ascending_node")

    @property
    def argument_of_periapsis(self) -> float:
        """Argument of periapsis at the first reading, rad."""
        return self.native_number("argument_of_periapsis")

    @property
    def true_anomaly(self) -> float:
        """True anomaly at the first reading, rad."""
        return self.native_number("true_anomaly")

    @property
    def beta_angle(self) -> float:
        """Angle between the orbit's normal and the Sun, rad."""
        return self.native_number("beta_angle")

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_spacecraft_hub(**kwargs)

    @default_args(
        mass=330,
        width=1.38,
        depth=1.04,
        height=1.58,
        sigma_init=_random_attitude,
        omega_init=_random_rate,
        rN=None,
        vN=None,
        oe=random_orbit,
        mu=MU_EARTH * 1e9,
        min_orbital_radius=(REQ_EARTH + 200) * 1e3,
    )
    def setup_spacecraft_hub(
        self,
        mass: float,
        width: float,
        depth: float,
        height: float,
        sigma_init: Iterable[float],
        omega_init: Iterable[float],
        oe: Any,
        rN: Iterable[float] | None,
        vN: Iterable[float] | None,
        mu: float,
        min_orbital_radius: float,
        **kwargs: Any,
    ) -> None:
        """Sets up the body, a uniform box of `mass` kg with sides in m, and its initial state.

        The orbit is given by elements `oe` (a in m, angles in rad) or by `rN` (m) and `vN` (m/s).
        `sigma_init` is an MRP, `omega_init` is in rad/s, `min_orbital_radius` in m.
        """
        self.mu = mu
        if oe is not None:
            rN, vN = elem2rv(mu, oe)
        share = mass / 12.0
        moments = (width**2 + depth**2, depth**2 + height**2, width**2 + height**2)
        self.I_mat = [0.0] * 9
        self.I_mat[0::4] = [share * moment for moment in moments]
        self.min_orbital_radius = min_orbital_radius
        hub = Parameters(
            mHub=mass,
            IHubPntBc_B=self.I_mat,
            sigma_BNInit=sigma_init,
            omega_BN_BInit=omega_init,
            r_CN_NInit=rN,
            v_CN_NInit=vN,
        )
        self.scObject = Parameters(ModelTag=self.satellite.name, hub=hub, scStateOutMsg=Message(self._state, self))

    def _state(self) -> SCStatesMsgPayload:
        """Payload of the satellite's state."""
        position, velocity = self.r_BN_N, self.v_BN_N
        return SCStatesMsgPayload(
            r_BN_N=position,
            v_BN_N=velocity,
            r_CN_N=position,
            v_CN_N=velocity,
            sigma_BN=self.sigma_BN,
            omega_BN_B=self.omega_BN_B,
        )

    @aliveness_checker
    def altitude_valid(self) -> bool:
        """Returns whether the orbit is above `min_orbital_radius`."""
        x, y, z = self.r_BN_N
        return bool((x * x + y * y + z * z) ** 0.5 > self.min_orbital_radius)


class EclipseDynModel(DynamicsModel):
    """Satellite that knows whether it is in eclipse."""

    @classmethod
    def _requires_world(cls) -> list[type]:
        return [world.EclipseWorldModel, *super()._requires_world()]

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.eclipse_index: int = self.world.add_eclipse_message(self)


class DisturbanceTorqueDynModel(DynamicsModel):
    """Satellite under a constant torque."""

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_disturbance_torque(**kwargs)

    @default_args(disturbance_vector=None)
    def setup_disturbance_torque(self, disturbance_vector: Iterable[float] | None = None, **kwargs: Any) -> None:
        """Sets up a constant torque in body axes, N·m; None is no torque."""
        torque = np.zeros(3) if disturbance_vector is None else disturbance_vector
        self.extForceTorqueObject = Parameters(extTorquePntB_B=torque)


class AtmosphericDragDynModel(DynamicsModel):
    """Satellite with drag in the atmosphere."""

    @classmethod
    def _requires_world(cls) -> list[type]:
        return [world.AtmosphereWorldModel, *super()._requires_world()]

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_drag_effector(**kwargs)

    @default_args(dragCoeff=2.2, panelArea=2 * 1.0 * 0.5)
    def setup_drag_effector(self, dragCoeff: float, panelArea: float, **kwargs: Any) -> None:
        """Sets up the drag of the body and of a panel of `panelArea` m²."""
        self.dragEffector = Parameters(dragCoeff=dragCoeff, panelArea=panelArea)
