"""Observations of properties: of the satellite, and of upcoming opportunities."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np

from ..sim.model_names import defining_class, is_own
from .observations import Observation, Plan, as_number

logger = logging.getLogger("sparring.tasking.obs.observations")

#: Properties of the models that the simulation computes, and their numbers of values.
_VECTORS = ("sigma_BN", "omega_BN_B", "r_BN_N", "r_BN_P", "v_BN_N", "v_BN_P", "omega_BP_P")
NATIVE_PROPERTIES: dict[str, int] = {
    **dict.fromkeys(_VECTORS, 3),
    **dict.fromkeys(("omega_BH_H", "wheel_speeds", "wheel_speeds_fraction"), 3),
    **dict.fromkeys(("c_hat_P", "c_hat_H"), 3),
    **dict.fromkeys(("BN", "BP", "HN"), 9),
    **dict.fromkeys(("semi_major_axis", "eccentricity", "inclination", "ascending_node"), 1),
    **dict.fromkeys(("argument_of_periapsis", "true_anomaly", "beta_angle"), 1),
    **dict.fromkeys(("battery_charge", "battery_charge_fraction"), 1),
    **dict.fromkeys(("storage_level", "storage_level_fraction"), 1),
}


class SatProperties(Observation):
    """Properties of the satellite's models, or values of functions of the satellite.

    Each property is a dictionary: `prop`, its name; `module`, "dynamics" or "fsw", found if
    absent; `norm`, a divisor; `name`, its name in the observation; `fn`, a function of the
    satellite that replaces it.
    """

    def __init__(self, *obs_properties: dict[str, Any], name: str = "sat_props") -> None:
        super().__init__(name=name)
        for item in obs_properties:
            for key in item:
                if key not in ("prop", "module", "norm", "name", "fn"):
                    raise ValueError(f"Invalid property key: {key}")
            item.setdefault("norm", 1.0)
            if "name" not in item:
                item["name"] = item["prop"] + _suffix(item["norm"])
        self.obs_properties = obs_properties

    def reset_post_sim_init(self) -> None:
        """Finds the model of each property that names none."""
        for item in self.obs_properties:
            if "module" in item or "fn" in item:
                continue
            for module in ("dynamics", "fsw"):
                if hasattr(getattr(self.satellite, module), item["prop"]):
                    item["module"] = module
                    break
            else:
                raise AttributeError(f"Property {item['prop']} not found")

    def _value(self, item: dict[str, Any]) -> Any:
        """Value of a property divided by its norm."""
        value = item["fn"](self.satellite) if "fn" in item else getattr(getattr(self.satellite, item["module"]), item["prop"])
        if isinstance(value, list):
            value = np.array(value)
        return value / item["norm"]

    def get_obs(self) -> dict[str, Any]:
        """Returns the values by name."""
        return {item["name"]: self._value(item) for item in self.obs_properties}

    def _is_native(self, item: dict[str, Any]) -> bool:
        """Whether the simulation computes a property: a built-in one that no class overrides."""
        if "fn" in item or item["prop"] not in NATIVE_PROPERTIES:
            return False
        if as_number(item["norm"]) is None:
            return False
        models = {"dynamics": self.satellite.dyn_type, "fsw": self.satellite.fsw_type}
        modules = [item["module"]] if "module" in item else ["dynamics", "fsw"]
        for module in modules:
            owner = defining_class(models[module], item["prop"])
            if owner is not None:
                return is_own(owner) and item["prop"] not in vars(models[module])
        return False

    def plan(self) -> Plan:
        """Returns which properties the simulation computes."""
        if type(self).get_obs is not SatProperties.get_obs or _has_equal_names(self.obs_properties):
            return super().plan()
        plan = Plan()
        described = []
        for item in self.obs_properties:
            if self._is_native(item):
                described.append({key: item[key] for key in ("prop", "norm", "name")})
                plan.add_native(NATIVE_PROPERTIES[item["prop"]])
            else:
                plan.add_python(lambda item=item: self._value(item))
        if described:
            plan.items = [{"type": "SatProperties", "name": self.name, "properties": described}]
        return plan


def _has_equal_names(items: tuple[dict[str, Any], ...]) -> bool:
    """Whether two properties have the same name, of which only the last one is observed."""
    return len({item["name"] for item in items}) < len(items)


def _suffix(norm: Any) -> str:
    """Ending of the name of a value that is divided."""
    return "" if np.all(norm == 1.0) else "_normd"


def _hill_position(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Position of the object relative to the satellite in the Hill frame, m."""
    place = satellite.simulator.world.PN.T @ opportunity["object"].r_LP_P
    return satellite.dynamics.HN @ (place - np.array(satellite.dynamics.r_BN_N))


def _angle(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Angle between the instrument and the object, rad."""
    line = opportunity["r_LP_P"] - satellite.dynamics.r_BN_P
    return np.arccos(np.dot(line / np.linalg.norm(line), satellite.fsw.c_hat_P))


def _angle_rate(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Rate of the frame that points at the object, relative to the body, rad/s."""
    line = opportunity["object"].r_LP_P - satellite.dynamics.r_BN_P
    turn = np.cross(satellite.dynamics.v_BN_P, line) / np.linalg.norm(line) ** 2
    return np.linalg.norm(satellite.dynamics.omega_BP_P - turn)


def _priority(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Priority of the target."""
    return opportunity["object"].priority


def _position(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Planet-fixed position of the object, m."""
    return opportunity["r_LP_P"]


def _opening(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Time until the window opens, s."""
    return opportunity["window"][0] - satellite.simulator.sim_time


def _close(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Time until the window closes, s."""
    return opportunity["window"][1] - satellite.simulator.sim_time


def _middle(satellite: Any, opportunity: dict[str, Any]) -> Any:
    """Time until the middle of the window, s."""
    return sum(opportunity["window"]) / 2 - satellite.simulator.sim_time


PRESET_FUNCTIONS: dict[str, Callable[[Any, dict[str, Any]], Any]] = {
    "priority": _priority,
    "r_LP_P": _position,
    "r_LB_H": _hill_position,
    "opportunity_open": _opening,
    "opportunity_mid": _middle,
    "opportunity_close": _close,
    "target_angle": _angle,
    "target_angle_rate": _angle_rate,
}


class OpportunityProperties(Observation):
    """Properties of the next `n_ahead_observe` opportunities of a type.

    Each property is a dictionary: `prop`, one of the presets (`priority`, `r_LP_P`, `r_LB_H`,
    `opportunity_open`, `opportunity_mid`, `opportunity_close`, `target_angle`,
    `target_angle_rate`); or `fn`, a function of satellite and opportunity; `norm`, a divisor;
    `name`, its name in the observation.
    """

    _fn_map = PRESET_FUNCTIONS

    def __init__(
        self,
        *target_properties: dict[str, Any],
        n_ahead_observe: int,
        type: Any = "target",
        name: str | None = None,
    ) -> None:
        super().__init__(name=type if name is None else name)
        self.type = type
        self.target_properties = target_properties
        for number, item in enumerate(target_properties):
            self._complete(number, item)
        self.n_ahead_observe = int(n_ahead_observe)

    def _complete(self, number: int, item: dict[str, Any]) -> None:
        """Adds the function, norm and name that a property does not give."""
        for key in item:
            if key not in ("fn", "norm", "name", "prop"):
                raise ValueError(f"Invalid property key: {key}")
        item.setdefault("norm", 1.0)
        prop = item.get("prop")
        if "fn" not in item:
            if prop not in self._fn_map:
                raise ValueError(f"Property prop={prop} is not predefined and no `fn` was provided.")
            item["fn"] = self._fn_map[prop]
        elif prop in self._fn_map and item["fn"] is not self._fn_map[prop]:
            logger.warning(f"Ignoring default function for `{prop}` when `fn` is provided.")
        if "name" not in item:
            item["name"] = (prop or f"prop_{number}") + _suffix(item["norm"])

    def _found(self) -> list[dict[str, Any]]:
        """The next opportunities of the type."""
        find = getattr(self.satellite, "find_next_opportunities", None)
        if find is None:
            logger.warning("OpportunityProperties observation requires an AccessSatellite")
        found: list[dict[str, Any]] = self.satellite.find_next_opportunities(n=self.n_ahead_observe, types=self.type, pad=True)
        return found

    def get_obs(self) -> dict[str, Any]:
        """Returns the values by opportunity and name."""
        return {
            f"{self.name}_{number}": {
                item["name"]: item["fn"](self.satellite, opportunity) / item["norm"] for item in self.target_properties
            }
            for number, opportunity in enumerate(self._found())
        }

    def _is_native(self, item: dict[str, Any]) -> bool:
        """Whether the simulation computes a property: a preset with a number as norm."""
        prop = item.get("prop")
        is_preset = prop in PRESET_FUNCTIONS and item["fn"] is PRESET_FUNCTIONS[prop]
        return is_preset and as_number(item["norm"]) is not None

    def plan(self) -> Plan:
        """Returns which properties the simulation computes."""
        from ..sats.access_satellite import KINDS, MAX_FOUND, AccessSatellite

        find = getattr(type(self.satellite), "find_next_opportunities", None)
        is_usual = find is AccessSatellite.find_next_opportunities and self.type in KINDS
        natives = [item for item in self.target_properties if self._is_native(item)]
        has_own = type(self).get_obs is not OpportunityProperties.get_obs or _has_equal_names(self.target_properties)
        simulator = getattr(self.satellite, "simulator", None)
        if self.type == "target" and simulator is not None:
            is_usual = is_usual and simulator.are_targets_plain()
        if has_own or not is_usual or not natives or not 1 <= self.n_ahead_observe <= MAX_FOUND:
            return super().plan()
        plan = Plan()
        described = [{key: item[key] for key in ("prop", "norm", "name")} for item in natives]
        plan.items = [
            {
                "type": "OpportunityProperties",
                "name": self.name,
                "opportunity_type": self.type,
                "n_ahead_observe": self.n_ahead_observe,
                "properties": described,
            }
        ]
        for number in range(self.n_ahead_observe):
            for item in self.target_properties:
                if self._is_native(item):
                    count = 3 if item["prop"] in ("r_LP_P", "r_LB_H") else 1
                    plan.add_native(count)
                else:
                    plan.add_python(
                        lambda number=number, item=item: item["fn"](self.satellite, self._found()[number]) / item["norm"]
                    )
        return plan
