"""Light transport: surface points, path-traced reference radiance, G-buffers and training samples."""

from lightwell.transport.adaptive import refine as refine
from lightwell.transport.camera import gbuffer as gbuffer
from lightwell.transport.camera import reference_image as reference_image
from lightwell.transport.camera import static_image as static_image
from lightwell.transport.camera import total_image as total_image
from lightwell.transport.collect import collect as collect
from lightwell.transport.collect import join as join
from lightwell.transport.interactions import interaction as interaction
from lightwell.transport.point_rejection import Rejection as Rejection
from lightwell.transport.point_rejection import reject as reject
from lightwell.transport.queries import make_query as make_query
from lightwell.transport.radiance import PathReport as PathReport
from lightwell.transport.radiance import direct as direct
from lightwell.transport.radiance import indirect as indirect
from lightwell.transport.radiance import static as static
from lightwell.transport.samples import Query as Query
from lightwell.transport.samples import Samples as Samples
from lightwell.transport.samples import SurfacePoints as SurfacePoints
from lightwell.transport.shards import ShardSettings as ShardSettings
from lightwell.transport.shards import generate as generate
from lightwell.transport.shards import load_samples as load_samples
from lightwell.transport.surface import SurfaceDraw as SurfaceDraw
from lightwell.transport.surface import draw_surface as draw_surface
from lightwell.transport.surface import sample_surface as sample_surface
