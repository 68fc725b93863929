"""The picture of a comparison's page: the shipped recording, compared, and the top of its page as Chromium shows it.

python docs/images/make_report.py
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[2]
SIZE = (1280, 1360)
COMPARE = (sys.executable, "-m", "tbm_gsa.app.cli.main", "compare", "bags/field_dz101", "--no-keep")


def main() -> None:
    """Make docs/images/compare_report.png."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        sys.exit("no Chromium, which draws the page")
    picture = Path(__file__).with_name("compare_report.png")
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, "page.html")
        subprocess.run([*COMPARE, "--html", str(page)], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
        options = (
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--hide-scrollbars",
            f"--user-data-dir={folder}/profile",
        )
        shot = (f"--window-size={SIZE[0]},{SIZE[1]}", f"--screenshot={picture}", page.as_uri())
        subprocess.run([browser, *options, *shot], check=True, capture_output=True)
    Image.open(picture).convert("RGB").quantize(128).save(picture, optimize=True)  # a third of the size


if __name__ == "__main__":
    main()
