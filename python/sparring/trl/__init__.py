"""TRL: an `environment_factory` whose groups run the curriculum's scenarios, and a callback for the curriculum's metrics.

`GRPOTrainer` and `AsyncGRPOTrainer` accept it; `Environments` has several by name.

curriculum = sparring.Curriculum("http://127.0.0.1:8700", settings={"tasks": ["kessler/survival"], "group_size": 8})
envs = sparring.trl.EnvironmentFactory(curriculum, group_size=8)
trainer = GRPOTrainer(
    model="Qwen/Qwen3-4B",
    args=GRPOConfig(num_generations=8, per_device_train_batch_size=8, report_to="tensorboard"),
    train_dataset=envs.dataset(1000),
    environment_factory=envs,
    callbacks=[sparring.trl.CurriculumCallback(envs)],
)
trainer.train()
envs.close()
"""

from ..docking_episode import DOCKING_PROMPT, describe_docking
from ..tasking_episode import IMAGING_PROMPT, SCANNING_PROMPT, describe_tasking
from ..text_episode import Reward
from ..text_obs import describe_telemetry
from ..tool_episode import PROMPT
from .callback import CurriculumCallback
from .environments import Environments
from .factory import EnvironmentFactory
from .tool_environment import DockingEnvironment, ImagingEnvironment, ScanningEnvironment, ToolEnvironment
from .worker import WorkerFactory

__all__ = [
    "DOCKING_PROMPT",
    "IMAGING_PROMPT",
    "PROMPT",
    "SCANNING_PROMPT",
    "CurriculumCallback",
    "DockingEnvironment",
    "EnvironmentFactory",
    "Environments",
    "ImagingEnvironment",
    "Reward",
    "ScanningEnvironment",
    "ToolEnvironment",
    "WorkerFactory",
    "describe_docking",
    "describe_tasking",
    "describe_telemetry",
]
