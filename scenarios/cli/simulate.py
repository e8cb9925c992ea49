"""excite simulate."""

import click

from excite.errors import ExciteError
from excite.files import load_signal, save_recording
from excite.files.formats import writable
from scenarios.cli.common import assignments
from scenarios.cli.output import new_file


@click.command()
@click.argument("plant")
@click.option("--input", "file", required=True, type=click.Path(), help="Signal file to play.")
@click.option("--inject", metavar="NAME", help="Where the signal enters; the plant's first place when not given.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the noise.")
@click.option("--no-noise", is_flag=True, help="Switch all noise off.")
@click.option("--preset", metavar="NAME", help="Preset of the plant.")
@click.option("--set", "parameters", multiple=True, metavar="KEY=VALUE", help="Override a plant parameter.")
@click.option("-o", "out", required=True, type=click.Path(), help="Recording to write (.npz keeps everything).")
@click.option(
    "--clip", type=click.Path(), metavar="FILE.gif", help="Film the flight (quadrotor; needs offscreen graphics)."
)
def simulate(
    plant: str,
    file: str,
    inject: str | None,
    seed: int,
    no_noise: bool,
    preset: str | None,
    parameters: tuple[str, ...],
    out: str,
    clip: str | None,
) -> int:
    """Play a signal file on a simulated PLANT and record it."""
    from plants.registry import load_plant

    if clip is not None and (plant != "quadrotor" or new_file(clip, file, out).suffix.lower() != ".gif"):
        raise ExciteError(f"--clip {clip}: only flights of the quadrotor can be filmed, into a file that ends in .gif")
    writable(new_file(out, file))
    chosen = load_plant(plant, preset=preset, parameters=assignments(parameters, "--set"))
    recording = chosen.run(load_signal(file), inject=inject, noise=not no_noise, seed=seed)
    save_recording(recording, out)
    if clip is not None:
        from plants.quadrotor.picture import clip as film

        film(recording, clip)
    names = ", ".join(recording.views)
    click.echo(f"{out}: {len(recording.values)} samples, {len(recording.channels)} channels; views: {names}")
    return 0
