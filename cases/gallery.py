"""The manual's gallery: runs the shipped cases and writes `gallery.md` with a small picture of each.

`python -m ifrdem.cases.gallery RUNS` runs the cases into the folder RUNS, those whose picture is not there yet, and
writes into `ifrdem/docs`.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from PIL import Image

from ifrdem.case import shipped

DOCS = Path(__file__).resolve().parents[1] / "ifrdem" / "docs"
WIDTH = 760
COLOURS = 32
ORDER = (
    "cooling",
    "driven",
    "shear",
    "mixture",
    "elastic",
    "vibrated",
    "thermal_walls",
    "drum",
    "coins_on_table",
    "coins_from_video",
    "impact_scan",
)


def shrink(picture: Path, small: Path) -> None:
    """Write a copy of a picture that is `WIDTH` pixels wide, in `COLOURS` colours."""
    with Image.open(picture) as image:
        height = round(image.height * WIDTH / image.width)
        copy = image.convert("RGB").resize((WIDTH, height), Image.Resampling.LANCZOS)
        copy.quantize(COLOURS, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            small, optimize=True
        )


def comment(name: str) -> str:
    """The first paragraph of a case's comment."""
    lines = (shipped.FOLDER / f"{name}.toml").read_text(encoding="utf-8").splitlines()
    paragraph = []
    for line in lines:
        text = line.removeprefix("#").strip()
        if not text:
            break
        paragraph.append(text)
    return " ".join(paragraph)


def section(name: str) -> str:
    """Markdown of one case: title, picture, command, and where the case stands."""
    return f"""## {shipped.title(name)}

![Picture of the case {name}](gallery/{name}.png)

{comment(name)}

```sh
ifrdem run {name}
```

The case: `cases/{name}.toml`, printed by `ifrdem new cases/{name}.toml -o -`.
"""


STUDY = """## A study: Haff's law and the ratio of temperatures for e_n and mu

![Temperatures of nine gases with bands over twenty seeds](gallery/study.png)

180 gases of 2,000 coins. Bands: two standard errors over 20 seeds. Dashed: kinetic theory of a homogeneous gas, which
holds until velocities and spins become correlated, the sooner the more is lost in a collision. [Studies](studies.md)
says how it is done.

```sh
ifrdem new study
ifrdem study study.toml
ifrdem plot study.nc T --over tau --by e_n
ifrdem plot study.nc theta --over tau --by e_n
```
"""


def page() -> str:
    """Markdown of the gallery."""
    head = """# Gallery

The shipped cases at their own settings. Made by `python -m ifrdem.cases.gallery RUNS`, which runs each case and
shrinks its picture.
"""
    return "\n".join((head, *(section(name) for name in ORDER), STUDY))


def study(runs: Path) -> None:
    """Run the study and write its picture, T above theta."""
    if not (runs / "study.nc").exists():
        for words in (["new", "study", "--force"], ["study", "study.toml"]):
            subprocess.run([sys.executable, "-m", "ifrdem", *words], check=True, cwd=runs)
    for what in ("T", "theta"):
        words = ["plot", "study.nc", what, "--over", "tau", "--by", "e_n", "--force"]
        subprocess.run([sys.executable, "-m", "ifrdem", *words], check=True, cwd=runs)
    with Image.open(runs / "study-T.png") as upper, Image.open(runs / "study-theta.png") as lower:
        both = Image.new("RGB", (upper.width, upper.height + lower.height))
        both.paste(upper, (0, 0))
        both.paste(lower, (0, upper.height))
        both.save(runs / "study.png")
    shrink(runs / "study.png", DOCS / "gallery" / "study.png")


def main(runs: Path) -> None:
    """Run the cases into a folder and write the page and its pictures."""
    runs.mkdir(parents=True, exist_ok=True)
    (DOCS / "gallery").mkdir(exist_ok=True)
    for name in ORDER:
        picture = runs / f"{name}.png"
        if not picture.exists():
            case = str(shipped.FOLDER / f"{name}.toml")
            subprocess.run(
                [sys.executable, "-m", "ifrdem", "run", case, "-o", str(runs), "--force"], check=True
            )
        shrink(picture, DOCS / "gallery" / f"{name}.png")
    study(runs)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
