"""Pictures of a scene with the integrator that the settings name."""

from __future__ import annotations

from typing import Any

from lightwell.rendering.settings import RenderSettings


def render(settings: RenderSettings, quiet: bool = True) -> dict[str, Any]:
    """Render a picture, or a sequence of pictures.

    A mistake of the user is a ``ValueError`` of one line with the cure, a file that cannot be read or written an
    ``OSError``.

    Args:
        settings: Settings of the picture.
        quiet: Whether a sequence shows no progress on standard error.

    Returns:
        Size, paths, light, mean radiance, seconds, warnings; JSON values.
    """
    # Imported here, because the radiance cache registers itself with Mitsuba and takes longer to load.
    if settings.integrator == "path":
        from lightwell.rendering.path import render_path

        return render_path(settings)
    if settings.integrator != "nrc":
        from lightwell.rendering.baselines import render_baseline

        return render_baseline(settings)
    from lightwell.cache.settings import parse_options

    cache = parse_options(settings.options.nrc)
    if settings.options.frames:
        from lightwell.core.progress import Progress
        from lightwell.rendering.sequence import render_sequence

        return render_sequence(settings, cache, progress=Progress(quiet))
    from lightwell.rendering.nrc import render_nrc

    return render_nrc(settings, cache)
