"""Headway from Python: events in, versions out, and accelerations from what serves.

from headway import Client

model = Client("http://127.0.0.1:8080").model("default")
model.upload(frame, regime="fast")
model.train()
model.predict(windows).accel_mps2
"""

from .answers import Batch, ModelInfo, Simulation, Version
from .async_client import AsyncClient, AsyncModel
from .client import Client, Model
from .patience import Patience
from .problem import HeadwayError, Problem, TaskFailed, Unreachable
from .progress import Progress
from .windows import Predictions

__all__ = [
    "AsyncClient",
    "AsyncModel",
    "Batch",
    "Client",
    "HeadwayError",
    "Model",
    "ModelInfo",
    "Patience",
    "Predictions",
    "Problem",
    "Progress",
    "Simulation",
    "TaskFailed",
    "Unreachable",
    "Version",
]
