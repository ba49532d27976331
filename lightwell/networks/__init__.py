"""Small networks in tensor mode: layers, losses, schedules and the training loop with checkpoints."""

from lightwell.networks.losses import LOSSES as LOSSES
from lightwell.networks.mlp import Mlp as Mlp
from lightwell.networks.schedules import SCHEDULES as SCHEDULES
from lightwell.networks.training import Trainer as Trainer
from lightwell.networks.training import TrainingSet as TrainingSet
from lightwell.networks.training import TrainingSettings as TrainingSettings
