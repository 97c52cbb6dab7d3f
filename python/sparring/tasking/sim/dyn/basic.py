"""Platform of a satellite: wheels, thrusters, panel and battery."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ...messaging import Message, PowerStorageStatusMsgPayload, RWSpeedMsgPayload
from ...utils import actuator_primitives
from ...utils.elements import Vector
from ...utils.functional import aliveness_checker, default_args
from ..parameters import FixedAttribute, Parameters
from .base import (
    AtmosphericDragDynModel,
    DisturbanceTorqueDynModel,
    DynamicsModel,
    EclipseDynModel,
)

RPM_TO_RAD_S = 2.0 * np.pi / 60.0


def _random_wheel_speeds() -> Vector:
    """Draws the speeds of the wheels, rpm."""
    return np.random.uniform(-1500, 1500, 3)


def _random_charge() -> float:
    """Draws the charge of the battery, W·s."""
    return np.random.uniform(30.0 * 3600.0, 70.0 * 3600.0)


class BasicDynamicsModel(EclipseDynModel, DisturbanceTorqueDynModel, AtmosphericDragDynModel, DynamicsModel):
    """Satellite with three wheels, thrusters that desaturate them, a solar panel and a battery."""

    maxWheelSpeed = FixedAttribute()

    @property
    def battery_charge(self) -> float:
        """Charge of the battery, W·s."""
        if self.is_overwritten:
            return float(self.powerMonitor.batPowerOutMsg.read().storageLevel)
        return self.native_number("battery_charge")

    @property
    def battery_charge_fraction(self) -> float:
        """Battery charge as a share of the capacity."""
        return self.battery_charge / float(self.powerMonitor.storageCapacity)

    @property
    def wheel_speeds(self) -> Vector:
        """Speeds of the wheels, rad/s."""
        return np.array(self.rwStateEffector.rwSpeedOutMsg.read().wheelSpeeds)[0:3]

    @property
    def wheel_speeds_fraction(self) -> Vector:
        """Speeds of the wheels as shares of the failure limit."""
        limit: float = self.maxWheelSpeed * RPM_TO_RAD_S
        return self.wheel_speeds / limit

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_reaction_wheel_dyn_effector(**kwargs)
        self.setup_solar_panel(**kwargs)
        self.setup_battery(**kwargs)
        self.setup_power_sink(**kwargs)
        self.setup_reaction_wheel_power(**kwargs)
        self.setup_thruster_power(**kwargs)

    @default_args(wheelSpeeds=_random_wheel_speeds, maxWheelSpeed=np.inf, u_max=0.200)
    def setup_reaction_wheel_dyn_effector(
        self, wheelSpeeds: Iterable[float], maxWheelSpeed: float, u_max: float, **kwargs: Any
    ) -> None:
        """Sets up the wheels: initial speeds and failure limit in rpm, largest torque in N·m."""
        self.maxWheelSpeed = maxWheelSpeed
        wheels, factory, _ = actuator_primitives.balancedHR16Triad(wheelSpeeds=list(wheelSpeeds))
        wheels.rwList = {name: replace(wheel, u_max=u_max) for name, wheel in wheels.rwList.items()}
        wheels.rwSpeedOutMsg = Message(self._wheel_speeds, self)
        self.rwStateEffector, self.rwFactory = wheels, factory

    def _wheel_speeds(self) -> RWSpeedMsgPayload:
        """Payload of the wheels' speeds, rad/s."""
        return RWSpeedMsgPayload(wheelSpeeds=self.native_value("wheel_speeds"))

    @aliveness_checker
    def rw_speeds_valid(self) -> bool:
        """Returns whether no wheel is faster than `maxWheelSpeed`."""
        limit = self.maxWheelSpeed * RPM_TO_RAD_S
        speeds = self.rwStateEffector.rwSpeedOutMsg.read().wheelSpeeds[0:3]
        return all(abs(speed) < limit for speed in speeds)

    @default_args(thrusterPowerDraw=0.0)
    def setup_thruster_power(self, thrusterPowerDraw: float, **kwargs: Any) -> None:
        """Sets up the power of desaturation, W, negative for a draw."""
        self.thrusterPowerSink = Parameters(nodePowerOut=thrusterPowerDraw)

    @default_args(panelArea=2 * 1.0 * 0.5, panelEfficiency=0.20, nHat_B=np.array([0, 0, -1]))
    def setup_solar_panel(self, panelArea: float, panelEfficiency: float, nHat_B: Iterable[float], **kwargs: Any) -> None:
        """Sets up the panel: area in m², efficiency, and normal in body axes."""
        self.solarPanel = Parameters(panelArea=panelArea, panelEfficiency=panelEfficiency, nHat_B=nHat_B)

    @default_args(
        batteryStorageCapacity=80.0 * 3600.0,
        storedCharge_Init=_random_charge,
    )
    def setup_battery(self, batteryStorageCapacity: float, storedCharge_Init: float, **kwargs: Any) -> None:
        """Sets up the battery: capacity and initial charge in W·s."""
        if storedCharge_Init > batteryStorageCapacity or storedCharge_Init < 0:
            self.logger.warning(
                f"Battery initial charge {storedCharge_Init} incompatible with its capacity {batteryStorageCapacity}."
            )
        self.powerMonitor = Parameters(
            storageCapacity=batteryStorageCapacity,
            storedCharge_Init=storedCharge_Init,
            batPowerOutMsg=Message(self._battery, self),
        )

    def _battery(self) -> PowerStorageStatusMsgPayload:
        """Payload of the battery's state."""
        payload = PowerStorageStatusMsgPayload(
            storageLevel=self.native_number("battery_charge"),
            storageCapacity=self.powerMonitor.storageCapacity,
        )
        del payload.currentNetPower
        return payload

    @aliveness_checker
    def battery_valid(self) -> bool:
        """Returns whether the battery has charge at this moment."""
        return self.battery_charge > 0

    @default_args(basePowerDraw=0.0)
    def setup_power_sink(self, basePowerDraw: float, **kwargs: Any) -> None:
        """Sets up the constant power of the platform, W, negative for a draw."""
        if basePowerDraw > 0:
            self.logger.warning("basePowerDraw should probably be zero or negative.")
        self.basePowerSink = Parameters(nodePowerOut=basePowerDraw)

    @default_args(rwBasePower=0.4, rwMechToElecEfficiency=0.0, rwElecToMechEfficiency=0.5)
    def setup_reaction_wheel_power(
        self,
        rwBasePower: float,
        rwMechToElecEfficiency: float,
        rwElecToMechEfficiency: float,
        **kwargs: Any,
    ) -> None:
        """Sets up the power of each wheel: constant draw in W, and efficiencies."""
        self.rwPowerList = [
            Parameters(
                basePowerNeed=rwBasePower,
                mechToElecEfficiency=rwMechToElecEfficiency,
                elecToMechEfficiency=rwElecToMechEfficiency,
            )
            for _ in range(self.rwFactory.getNumOfDevices())
        ]
