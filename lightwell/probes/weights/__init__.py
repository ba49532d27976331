"""Weight functions: the trust ρ(u) of a probe in its cube, stored in about a hundred bytes."""

from lightwell.probes.weights.bare import UnweightedTrilinear as UnweightedTrilinear
from lightwell.probes.weights.bare import core as core
from lightwell.probes.weights.bare import ratio as ratio
from lightwell.probes.weights.common import Close as Close
from lightwell.probes.weights.common import Fit as Fit
from lightwell.probes.weights.common import WeightFunction as WeightFunction
from lightwell.probes.weights.common import error as error
from lightwell.probes.weights.common import leak as leak
from lightwell.probes.weights.common import point_weight as point_weight
from lightwell.probes.weights.common import trusted as trusted
from lightwell.probes.weights.common import under as under
from lightwell.probes.weights.mlp import TinyMlp as TinyMlp
from lightwell.probes.weights.product import ProductField
from lightwell.probes.weights.refine import refine as refine
from lightwell.probes.weights.relu import ReluField

# By the name in files: our form, hat × ratio, in four sizes,
_OURS: dict[str, WeightFunction] = {
    "relu-field": ReluField(4),
    "relu-field-5": ReluField(5),
    "product-field": ProductField(5, 2),
    "mlp": TinyMlp(),
}
# and the published form of three of them, which learn the whole weight.
_BARE = {f"bare-{name}": UnweightedTrilinear(_OURS[name]) for name in ("relu-field-5", "product-field", "mlp")}
FUNCTIONS: dict[str, WeightFunction] = _OURS | _BARE
