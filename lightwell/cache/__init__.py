"""Neural radiance cache: a path tracer that trains a small network while it renders.

Importing this package registers the integrator ``lightwell_nrc``.
"""

from lightwell.cache.integrator import NrcIntegrator as NrcIntegrator
from lightwell.cache.integrator import register as register
from lightwell.cache.radiance_cache import RadianceCache as RadianceCache
from lightwell.cache.settings import CacheSettings as CacheSettings
from lightwell.cache.settings import settings_of as settings_of

register()
