"""`trepid train`: a network that steers as the drivers of a data set did; `trepid quantise`: with 8 bits."""

import json
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Column, Table

from learning.models.catalogue import MODELS, model
from learning.rendered import need_torch, say
from learning.training.recipe import load_recipe
from trepid.config import INTERRUPTED, InputError, parse_overrides, refuse
from trepid.options import Car, typed_command

if TYPE_CHECKING:
    from learning.dataset.dataset import Dataset

LIST = "list"


def train(
    name: Annotated[str, typer.Option("--model", metavar="NAME", help=f"The network; {LIST!r} prints all.")],
    data: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Data set of `trepid dataset build`.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="F.onnx", help="Weights file to write.")] = None,
    start: Annotated[
        Path | None,
        typer.Option(
            metavar="F.onnx",
            help="Begin with the weights of this network, which F.onnx.train holds; default: those of the recipe.",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="F.yaml", help="Recipe; its fields override those of config/driving_train.yaml."
        ),
    ] = None,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Another value for a field of the recipe; may be repeated."
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from the checkpoint beside the weights.")
    ] = False,
    sampler: Annotated[
        str | None,
        typer.Option(
            "--search",
            metavar="NAME",
            help="Search numbers of the recipe first, as proposed by tpe, random, cma-es, bat, bat-harmony, pso, de"
            " or ga; needs the extra 'tune'.",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=LOW..HIGH",
            help="With --search: this number of the recipe instead of those of config/driving_search.yaml; may be"
            " repeated.",
        ),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(
            min=1,
            help="With --search: trainings in all, those of earlier runs with the same storage included.",
        ),
    ] = 20,
    workers: Annotated[int, typer.Option(min=1, help="With --search: processes on this machine.")] = 1,
    storage: Annotated[
        str | None,
        typer.Option(
            metavar="URL|F.journal", help="With --search: storage of the trials; default: beside the weights."
        ),
    ] = None,
    car: Car = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the metadata of the weights as JSON.")
    ] = False,
) -> int:
    """Train a network to steer from the frames of a data set; needs the extra 'train'."""
    if name == LIST:
        _list(as_json)
        return 0
    model(name)
    if data is None or out is None:
        raise InputError("trepid train needs --data DIR, the data set, and --out F.onnx, the weights file")
    if out.suffix != ".onnx":
        raise InputError(f"--out {out}: the name of a weights file ends with .onnx")
    refuse_own_start(start, out)
    overrides = parse_overrides(changes or [])
    recipe = load_recipe(name, config, overrides=overrides)
    refuse("--vary and --storage belong to --search NAME", sampler is None and bool(vary or storage))
    refuse("--start begins with a network of its own recipe: without --search", bool(sampler and start))
    need_torch("train")
    from learning.dataset.card import count_phrase
    from learning.dataset.dataset import Dataset
    from learning.training.run import run

    opened = Dataset.open(data)
    searched: dict[str, Any] = {}
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        if sampler is not None:
            searched = _search(opened, name, out, config, overrides, sampler, vary, trials, workers, storage)
            recipe = load_recipe(name, config, overrides=overrides | searched["values"])
        found = run(
            opened, name, out, recipe, resume=resume, command=typed_command(), report=say, start=start
        )
    except KeyboardInterrupt:
        if sampler is None:
            raise
        say("interrupted: finished trainings are stored; the same command continues")
        return INTERRUPTED
    except OSError as error:
        raise InputError(f"{error.filename or out}: cannot be written: {error.strerror or error}") from error
    if as_json:
        print(json.dumps(found | ({"search": searched} if searched else {})))
    else:
        if searched:
            words = " ".join(f"--set {key}={value}" for key, value in searched["values"].items())
            typer.echo(f"best of {searched['trials']} recipes: {words}")
        mae, routes = found["scores"]["mae_deg"], count_phrase(len(found["trained_on"]), "route")
        typer.echo(
            f"{out}: {found['parameters']} weights, {mae:.3f}° mean error on the validation frames;"
            f" trained on {routes}"
        )
        typer.echo(f"{out.with_suffix('.md')}: its card")
        for one in found["findings"]:
            typer.echo(f"finding: {one['sentence']}")
        typer.echo(found["conclusion"])
    return 0


def _search(
    data: "Dataset",
    name: str,
    out: Path,
    config: Path | None,
    overrides: dict[str, str],
    sampler: str,
    vary: list[str] | None,
    trials: int,
    workers: int,
    storage: str | None,
) -> dict[str, Any]:
    """The best values of a search, and its figures. Raises InputError."""
    if find_spec("optuna") is None:
        raise InputError("trepid train --search needs Optuna: pip install 'trepid[tune]'")
    from learning.training.search import RecipeTask, search_recipe, searched_parameters
    from sim_harness.tuning.study import check_sampler

    check_sampler(sampler, "--search")
    recipe = load_recipe(name, config, overrides=overrides)
    task = RecipeTask(
        parameters=searched_parameters(vary or [], recipe),
        storage=storage or str(out.with_name(f"{out.name}.journal")),
        trials=trials,
        seed=recipe.seed,
        sampler=sampler,
        data=data.folder.resolve(),
        data_sha256=data.sha256,
        model=name,
        config=config.resolve() if config else None,
        changes=overrides,
        folder=out.parent.resolve(),
    )
    return search_recipe(task, workers, say)


def refuse_own_start(start: Path | None, out: Path) -> None:
    """Raise InputError where a training would overwrite the network that it begins with."""
    if start is not None and out.exists() and start.exists() and out.samefile(start):
        raise InputError(f"--out {out}: is the network of --start itself; name another file")


def quantise(
    network: Annotated[Path, typer.Argument(metavar="F.onnx", help="Driving network of `trepid train`.")],
    data: Annotated[Path, typer.Option(metavar="DIR", help="The data set of its training.")],
    out: Annotated[Path, typer.Option(metavar="G.onnx", help="Weights file to write.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the comparison as JSON.")] = False,
) -> int:
    """Convert a driving network to 8 bits where this pays; needs the extra 'train'."""
    if out.suffix != ".onnx":
        raise InputError(f"--out {out}: the name of a weights file ends with .onnx")
    if out.exists() and network.exists() and out.samefile(network):
        raise InputError(f"--out {out}: is the network itself; name another file")
    if not out.parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {out.parent}")
    need_torch("quantise")
    from learning.dataset.dataset import Dataset
    from learning.training.quantise import LEAST_GAIN, MOST_ERROR, quantise

    opened = Dataset.open(data)
    try:
        with tempfile.TemporaryDirectory() as work:
            found = quantise(network, opened, out, Path(work))
    except OSError as error:
        raise InputError(f"{error.filename or out}: cannot be written: {error.strerror or error}") from error
    if as_json:
        print(json.dumps(found._asdict() | {"gain": found.gain, "written": found.pays}))
        return 0 if found.pays else 1
    table = Table("bits", "MAE °", "ms", "file kB")
    columns = zip(("32", "8"), found.mae_deg, found.frame_ms, found.file_bytes, strict=True)
    for bits, mae_deg, frame_ms, size in columns:
        table.add_row(bits, f"{mae_deg:.3f}", f"{frame_ms:.3f}", f"{size / 1000:.0f}")
    Console().print(table)
    if found.pays:
        typer.echo(f"{out}: {found.gain:.2f} times as fast, angles change by {found.largest_change_deg:.2f}°")
        return 0
    typer.echo(
        f"{out}: not written; 8 bits pay with {LEAST_GAIN:g} times the speed and at most {MOST_ERROR:g} times the"
        f" error, found {found.gain:.2f} and {found.mae_deg[1] / found.mae_deg[0]:.3f}"
    )
    return 1


def _list(as_json: bool) -> None:
    if as_json:
        print(json.dumps([{"model": name, **one._asdict()} for name, one in MODELS.items()]))
        return
    whole = (Column(name, no_wrap=True) for name in ("model", "frame", "weights", "head", "memory"))
    table = Table(*whole, "source", box=None, pad_edge=False)
    for name, one in MODELS.items():
        memory = "yes" if one.recurrent else ""
        table.add_row(name, f"{one.width}x{one.height}", f"{one.parameters:,}", one.head, memory, one.source)
    Console().print(table)
