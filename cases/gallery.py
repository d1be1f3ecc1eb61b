"""The manual's pictures: runs the shipped cases and writes `gallery.md`, and draws the pictures of other pages.

`python -m ifrdem.cases.gallery RUNS` runs the cases into the folder RUNS, those whose picture is not there yet, and
writes into `ifrdem/docs`, the moving picture of the README among it. `... RUNS transport tail` draws these pictures
only. Those of other pages are drawn by the commands that stand there.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from PIL import Image

from ifrdem.case import shipped

DOCS = Path(__file__).resolve().parents[1] / "ifrdem" / "docs"
WIDTH, COLOURS = 960, 96
GREYS = 16
"""Greys of each picture: without them lines of the grid vanish, and frames and text take other colours."""
ORDER = (
    "cooling",
    "clusters",
    "driven",
    "driven_mixture",
    "shear",
    "mixture",
    "elastic",
    "vibrated",
    "brazil_nut",
    "thermal_walls",
    "drum",
    "avalanches",
    "hopper",
    "heap",
    "piston",
    "wake",
    "coins_on_table",
    "coins_from_video",
    "impact_scan",
)


POSTER = "--style poster"
WALL_WIDTH = 600
HERO_WIDTH, HERO_QUALITY = 1000, 40
WALL = {
    "streams": (
        "clusters", f"disks --color direction {POSTER}",
        "Directions of motion (yellow right, blue left, light up, dark down): bands where streams meet.",
    ),
    "cold": (
        "cooling", f"disks --color speed {POSTER}",
        "50,000 coins: the dense filaments are slow; coins between them fly on.",
    ),
    "banks": (
        "wake", f"disks --frames 70 {POSTER}",
        "A post ploughs through coins; those along the channel spin.",
    ),
    "turn": (
        "drum", f"disks --color direction {POSTER}",
        "Right and up with the drum (yellow, light), and down the slope to the left (blue, dark).",
    ),
    "floating": (
        "vibrated", f"disks --frames 120 --color speed {POSTER}",
        "A few hot coins on a shaken floor carry all the others.",
    ),
    "burst": (
        "coins_on_table", f"disks --frames 15 {POSTER}",
        "400 coins burst from a patch; those hit off-centre spin.",
    ),
    "sizes": (
        "mixture", f"disks --color radius {POSTER}",
        "10,000 disks with lognormal radii, at 0.4 of the area.",
    ),
    "break": (
        "coins_from_video", f"disks --frames 12 {POSTER}",
        "A square of nine coins and three others: the start is what a camera saw.",
    ),
    "pairs": (
        "impact_scan", f"disks --color speed {POSTER}",
        "321 impacts at 321 angles, each on its own.",
    ),
    "sheared": (
        "shear", f"disks --color direction {POSTER}",
        "Directions of motion relative to the imposed shear flow.",
    ),
    "heat": (
        "thermal_walls", f"disks --color temperature {POSTER}",
        "Heat goes from the hot wall on the left to the cold one.",
    ),
    "maps": (
        "driven", f"fields {POSTER}",
        "Density with the flow, and thermal temperature, of a gas that random kicks drive.",
    ),
}  # fmt: skip
"""Pictures for a wall: name -> case, words of `ifrdem plot`, caption."""
MOVIE = f"clusters.h5 --frames ::3 --fps 10 --size 400x422 --color direction {POSTER} --quality 35"
"""Words of `ifrdem movie` for the README's picture."""


HERO = "run clusters --set species[0].number=1000000 --set output.frames=4 --set run.name=million"
"""Words of the command that runs a million disks."""
HERO_PICTURE = f"plot million.h5 disks --color direction {POSTER}"


def shrink(
    picture: Path,
    small: Path,
    width: int = WIDTH,
    colours: int = COLOURS,
    method: Image.Quantize = Image.Quantize.MAXCOVERAGE,
) -> None:
    """Write a copy of a picture that is so many pixels wide, in so many colours, `GREYS` of them greys."""
    with Image.open(picture) as image:
        height = round(image.height * width / image.width)
        copy = image.convert("RGB").resize((width, height), Image.Resampling.LANCZOS)
    own = copy.quantize(colours - GREYS, method=method, dither=Image.Dither.NONE).getpalette() or []
    greys = [255 * i // (GREYS - 1) for i in range(GREYS)]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*own[: 3 * (colours - GREYS)], *(each for grey in greys for each in (grey,) * 3)])
    copy.quantize(palette=palette, dither=Image.Dither.NONE).save(small, optimize=True)


def on_the_wall(name: str) -> str:
    """Markdown of one picture for a wall."""
    case, words, text = WALL[name]
    return f"""### {shipped.title(case)}: {name}

![Poster of the case {case}](gallery/wall/{name}.png)

{text}

```sh
ifrdem plot {case}.h5 {words}
```
"""


def section(name: str) -> str:
    """Markdown of one case: title, picture, what it shows, command."""
    return f"""### {shipped.title(name)}

![Picture of the case {name}](gallery/{name}.png)

{_beyond_the_title(name)}

```sh
ifrdem run {name}
```
"""


def _beyond_the_title(name: str) -> str:
    """The comment of a shipped case or study without its title."""
    rest = shipped.comment(name).removeprefix(shipped.title(name)).lstrip(":. ")
    return rest[:1].upper() + rest[1:]


STUDY = """### A study: Haff's law and the ratio of temperatures for e_n and mu

![Temperatures of nine gases with bands over twenty seeds](gallery/study.png)

180 gases of 2,000 coins. Bands: 95 % intervals of the mean over 20 seeds. Dashed: kinetic theory of a homogeneous
gas, which holds until velocities and spins become correlated: sooner if collisions dissipate more energy.
[Studies](studies.md) says how it is done.

```sh
ifrdem new study
ifrdem study study.toml
ifrdem plot study.nc T --over tau --by e_n
ifrdem plot study.nc theta --over tau --by e_n
```
"""


MIXTURE = """### A study: temperatures and stresses of a driven mixture

![Temperatures of two species, their ratio, and the pressure tensor over e_n](gallery/mixture_study.png)

Bars: 95 % intervals of the mean over six seeds. Dashed: kinetic theory of a homogeneous mixture.
[Studies](studies.md#species-and-stresses) has the study file, the commands and the numbers.
"""


STUDIES: dict[str, tuple[tuple[str, ...], str]] = {
    "rough_cooling": (
        ("T --over tau --by beta", "theta --over beta"),
        "Bars: 95 % intervals of the mean over 12 seeds. Dashed: kinetic theory with Sonine's expansion.",
    ),
    "viscoelastic_cooling": (
        ("T --over t --by variant",),
        "Bands: 95 % intervals of the mean over 12 seeds. Dashed: kinetic theory.",
    ),
    "mixture_cooling": (
        ("species_T_ratio_light --over e_n --by mass",),
        "Bars: 95 % intervals of the mean over 12 seeds. Dashed: kinetic theory.",
    ),
    "shear_stress": (
        ("stress_N_1 --over e_n", "stress_T_x_over_T_y --over e_n", "stress_friction --over e_n"),
        "Bars: 95 % intervals of the mean over 8 seeds, beside kinetic theory of the steady flow.",
    ),
}
"""Shipped studies: words of `ifrdem plot` for each picture, and what bars and lines are."""


def of_study(name: str) -> str:
    """Markdown of a shipped study: title, picture, what it shows, commands."""
    pictures, text = STUDIES[name]
    commands = "\n".join(f"ifrdem plot {name}.nc {words}" for words in pictures)
    return f"""### {shipped.title(name)}

![Picture of the study {name}](gallery/{name}.png)

{_beyond_the_title(name)} {text}

```sh
ifrdem study {name}
{commands}
```
"""


COMPARED = """## Laws compared

Pictures of `ifrdem validate gas_laws` and `ifrdem validate lammps` are in [compare two laws in a gas](own-law.md#compare-two-laws-in-a-gas) and in
[which law for Hertz-Mindlin contacts](hertz-mindlin.md).
"""


def page() -> str:
    """Markdown of the gallery."""
    head = f"""# Gallery

This page shows every shipped case and study with its picture and its command. `ifrdem cases` lists them;
`ifrdem new cases/NAME.toml` and `ifrdem new studies/NAME.toml` copy one, to change it.

## Posters

A million disks after 120 collisions per disk, coloured by their directions of motion. The brightness of a
cell, 1.8 diameters wide, grows with its area fraction up to 0.6. The run has 60 million collisions; `ifrdem check`
estimates its time.

![Filaments and clusters in a gas of a million disks](gallery/million.webp)

```sh
ifrdem {HERO}
ifrdem {HERO_PICTURE}
```

The style `poster` has a scale bar instead of titles and axes. The pictures below take one command each, after
`ifrdem run CASE`; `ifrdem plot --help` lists the colours. `ifrdem movie` has the same colours and the same style:

![Moving picture of the case clusters](gallery/clusters.webp)

```sh
ifrdem movie {MOVIE} -o clusters.webp
```
"""
    wall = (on_the_wall(name) for name in WALL)
    cases = """## The cases

`ifrdem run CASE` draws this picture of each: temperatures against time (energies, where friction stops the disks) with
kinetic theory where it holds, profiles of a gas between walls, and the disks at the end, coloured by spin or species.
"""
    studies = """## Published results

Studies that come with the package: each repeats a published result in some minutes of processor time. `ifrdem validate gas_studies`
runs them and compares them with the formulas of the papers.
"""
    sections = (*(section(name) for name in ORDER), STUDY, MIXTURE)
    return "\n".join(
        (head, *wall, cases, *sections, studies, *(of_study(name) for name in STUDIES), COMPARED)
    )


def ifrdem(*words: str, cwd: Path) -> None:
    """Run a command of the package in a folder."""
    subprocess.run([sys.executable, "-m", "ifrdem", *words], check=True, cwd=cwd)


def study(runs: Path) -> None:
    """Run the study and write its picture, T above theta."""
    if not (runs / "study.nc").exists():
        for words in (["new", "study", "--force"], ["study", "study.toml"]):
            ifrdem(*words, cwd=runs)
    for what in ("T", "theta"):
        words = ["plot", "study.nc", what, "--over", "tau", "--by", "e_n"]
        ifrdem(*words, "--size", "9in", "--no-title", "--force", "-o", f"study-{what}.png", cwd=runs)
    with Image.open(runs / "study-T.png") as upper, Image.open(runs / "study-theta.png") as lower:
        both = Image.new("RGB", (upper.width, upper.height + lower.height))
        both.paste(upper, (0, 0))
        both.paste(lower, (0, upper.height))
        both.save(runs / "study.png")
    shrink(runs / "study.png", DOCS / "gallery" / "study.png", 1200)


def mixture_study(runs: Path) -> None:
    """Run the study of a driven mixture and write its picture: temperatures, their ratio and stresses, side by side."""
    if not (runs / "mixture_study.nc").exists():
        (runs / "mixture_study.toml").write_text(blocks("studies")["study mixture_study"])
        ifrdem("study", "mixture_study.toml", cwd=runs)
    plots = [f"{what} --over e_n" for what in ("species_temperature", "species_T_ratio_light", "stress")]
    side_by_side(runs, "mixture_study", plots)
    shrink(runs / "mixture_study.png", DOCS / "gallery" / "mixture_study.png", 1200)


def side_by_side(runs: Path, name: str, plots: Sequence[str]) -> None:
    """Write NAME.png: pictures of a study, by words of `ifrdem plot`, side by side."""
    pictures = []
    for words in plots:
        what, *options = words.split()
        picture = f"{name}-{what}.png"
        options += ["--size", "4in", "--no-title", "--force", "-o", picture]
        ifrdem("plot", f"{name}.nc", what, *options, cwd=runs)
        with Image.open(runs / picture) as image:
            pictures.append(image.convert("RGB"))
    all_of_them = Image.new(
        "RGB", (sum(each.width for each in pictures), max(each.height for each in pictures)), "white"
    )
    left = 0
    for each in pictures:  # their axes are as high as each other; legends differ
        all_of_them.paste(each, (left, all_of_them.height - each.height))
        left += each.width
    all_of_them.save(runs / f"{name}.png")


def shipped_study(name: str, runs: Path) -> None:
    """Run a shipped study and write its picture."""
    plots, _ = STUDIES[name]
    if not (runs / f"{name}.nc").exists():
        ifrdem("study", name, cwd=runs)
    side_by_side(runs, name, plots)
    small = DOCS / "gallery" / f"{name}.png"
    shrink(runs / f"{name}.png", small, 400 * len(plots) + 160 * (len(plots) == 1))


def laws(runs: Path) -> None:
    """Run the study of two laws and copy its picture."""
    picture = runs / "laws-report" / "gas_laws.png"
    if not picture.exists():
        ifrdem("validate", "gas_laws", "-o", "laws-report", "--force", cwd=runs)
    shrink(picture, DOCS / "gallery" / "laws.png", 1200, 192, Image.Quantize.FASTOCTREE)


def contacts(runs: Path) -> None:
    """Run the comparison with LAMMPS and copy its pictures."""
    names = ("lammps-impacts", "lammps-cooling", "lammps-driven")
    if not all((runs / "lammps-report" / f"{name}.png").exists() for name in names):
        ifrdem("validate", "lammps", "-o", "lammps-report", "--force", cwd=runs)
    for name in names:
        picture = runs / "lammps-report" / f"{name}.png"
        shrink(picture, DOCS / "gallery" / f"{name}.png", 1200, 192, Image.Quantize.FASTOCTREE)


def hero(runs: Path) -> None:
    """Run a million disks and copy their picture."""
    if not (runs / "million.h5").exists():
        ifrdem(*HERO.split(), "--force", cwd=runs)
    ifrdem(*HERO_PICTURE.split(), "--force", cwd=runs)
    with Image.open(runs / "million-disks.png") as image:
        height = round(image.height * HERO_WIDTH / image.width)
        copy = image.convert("RGB").resize((HERO_WIDTH, height), Image.Resampling.LANCZOS)
        copy.save(DOCS / "gallery" / "million.webp", quality=HERO_QUALITY, method=6)


DRAWN = {
    "cycle": 1000,
    "phases": 1200,
    "profiles": 1400,
    "species": 800,
    "own_time": 700,
    "vortices": 1000,
    "vorticity": 1000,
    "tail": 700,
    "transport": 1200,
    "film_to_gas": 1000,
    "fit": 1000,
    "compared": 800,
}
"""Pictures of other pages, and their widths in pixels.

Each has a block of commands on a page, which is marked `picture NAME` and writes NAME.png. Blocks that are marked `case
NAME`, `study NAME` and `script NAME` are its files.
"""
KEEPS = ("info", "study")
"""Commands of pages that have no option --force."""
SUFFIXES = {"case": ".toml", "study": ".toml", "script": ".py"}


def page_with(marker: str) -> str:
    """The one page of the manual that has a marked block."""
    (found,) = (each.stem for each in DOCS.glob("*.md") if f"<!-- {marker} -->\n" in each.read_text("utf-8"))
    return found


def blocks(page: str) -> dict[str, str]:
    """Marked blocks of code of a page of the manual, by their marks."""
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^<!-- (.*?) -->\n```\w+\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL))


FILMS = {"fit": ".", "compared": ".", "film_to_gas": ". 200"}
"""Pictures of films: words that make the film."""
FIRST = {
    "fit": "video",
    "compared": "video",
    "film_to_gas": "film to gas",
    "vortices": "picture own_time",
    "vorticity": "picture own_time",
}
"""Pictures whose commands need those of another block, which comes before."""


def drawn(name: str, runs: Path) -> None:
    """Draw a picture of another page by its commands; films, runs and studies that are there are not repeated."""
    page = page_with(f"picture {name}")
    folder, found = runs / page, blocks(page)
    folder.mkdir(parents=True, exist_ok=True)
    for marker, code in found.items():
        kind, _, file = marker.partition(" ")
        if kind in SUFFIXES:
            (folder / f"{file}{SUFFIXES[kind]}").write_text(code, encoding="utf-8")
    lines = found[FIRST[name]].splitlines() if name in FIRST else []
    if name in FILMS and not (folder / "tracks.csv").exists():
        lines.insert(0, f"python -m ifrdem.validation.fit_video {FILMS[name]}")
    for line in (*lines, *found[f"picture {name}"].splitlines()):
        program, *words = shlex.split(line, comments=True)
        if program == "python":
            subprocess.run([sys.executable, *words], check=True, cwd=folder)
        elif not any((folder / each).exists() for each in _results_of(words)):
            ifrdem(*words, *([] if words[0] in KEEPS else ["--force"]), cwd=folder)
    small = DOCS / "gallery" / f"{name}.png"
    shrink(folder / f"{name}.png", small, DRAWN[name], method=Image.Quantize.FASTOCTREE)


def _results_of(words: Sequence[str]) -> list[str]:
    """Files by which a command that computes is known to be done."""
    named = [word.partition("=")[2] for word in words if word.startswith("run.name=")] or [
        Path(words[1]).stem
    ]
    if words[0] == "run":
        return [f"{named[0]}.h5"]
    if words[0] == "study":
        return [words[words.index("-o") + 1]] if "-o" in words else [f"{named[0]}.nc", f"{named[0]}-study.nc"]
    return []


def the_case(name: str, runs: Path) -> None:
    """Run a shipped case and write its picture."""
    picture = runs / f"{name}.png"
    if not picture.exists():
        ifrdem("run", str(shipped.FOLDER / f"{name}.toml"), "-o", str(runs), "--force", cwd=Path())
    shrink(picture, DOCS / "gallery" / f"{name}.png")


def movie(runs: Path) -> None:
    """Make the moving picture of the README."""
    ifrdem("movie", *MOVIE.split(), "--force", "-o", str(DOCS / "gallery" / "clusters.webp"), cwd=runs)


def poster(name: str, runs: Path) -> None:
    """Draw a picture for a wall, of a case that has run."""
    case, words, _ = WALL[name]
    ifrdem("plot", f"{case}.h5", *words.split(), "--force", "-o", f"wall-{name}.png", cwd=runs)
    panels = 2 if words.startswith("fields") else 1
    small = DOCS / "gallery" / "wall" / f"{name}.png"
    shrink(runs / f"wall-{name}.png", small, panels * WALL_WIDTH)


PICTURES: dict[str, Callable[[Path], None]] = {
    **{name: partial(the_case, name) for name in ORDER},
    "million": hero,
    "movie": movie,
    **{name: partial(poster, name) for name in WALL},
    "study": study,
    "mixture_study": mixture_study,
    **{name: partial(shipped_study, name) for name in STUDIES},
    "laws": laws,
    "lammps": contacts,
    **{name: partial(drawn, name) for name in DRAWN},
}
"""Functions that make each picture, or group of pictures; those that need a run come after those that make it."""


def main(runs: Path, names: Sequence[str] = ()) -> None:
    """Make these pictures, or all, from runs in a folder, and write the page."""
    if unknown := [name for name in names if name not in PICTURES]:
        raise SystemExit(f"no picture is called {', '.join(unknown)}; there are {', '.join(PICTURES)}")
    runs.mkdir(parents=True, exist_ok=True)
    (DOCS / "gallery" / "wall").mkdir(parents=True, exist_ok=True)
    for name in names or PICTURES:
        PICTURES[name](runs)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
