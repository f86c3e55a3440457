"""The times of ``sextant demo``: ``python -m benchmarks.demo``.

A server is started by the command, and receives the page's requests. Times are from the command to the page, of the
first answer to each question, which includes loading models, and the median of five more. Photos are scikit-learn's,
640 x 427 pixels, and one of them enlarged to 12 megapixels.
"""

import io
import json
import re
import signal
import statistics
import subprocess
import sys
import time
from urllib.request import Request, urlopen

from PIL import Image

from benchmarks.machine import describe_machine
from sextant.pages.demo.answers import sample_photo

BOUNDARY = "0123456789abcdef"
AGAIN = 5


def ask(address: str, question: str, files: list[bytes], settings: dict[str, str]) -> float:
    """Seconds until the answer."""
    parts = [f'name="photo"; filename="photo{i}.jpg"\r\n\r\n'.encode() + each for i, each in enumerate(files)]
    parts += [f'name="{name}"\r\n\r\n{value}'.encode() for name, value in settings.items()]
    start = f"--{BOUNDARY}\r\nContent-Disposition: form-data; ".encode()
    body = b"".join(start + part + b"\r\n" for part in parts) + f"--{BOUNDARY}--\r\n".encode()
    headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
    began = time.perf_counter()
    with urlopen(Request(f"{address}ask/{question}", body, headers)) as response:
        json.loads(response.read())
    return time.perf_counter() - began


def main() -> None:
    china, flower = sample_photo("china.jpg"), sample_photo("flower.jpg")
    large = io.BytesIO()
    Image.open(io.BytesIO(china)).resize((4242, 2828)).save(large, "JPEG", quality=92)
    both = {"turned": "on", "resized": "on"}
    questions = {
        "one photo": ("photo", [china], {}),
        "one photo of 12 megapixels": ("photo", [large.getvalue()], {}),
        "two photos": ("places", [china, flower], {}),
        "one example": ("example", [china], {"points": "0,0.4,0.6"}),
        "one example in two photos, turned and of other sizes": (
            "example",
            [china, flower],
            {"points": "0,0.4,0.6", **both},
        ),
        "a digit": ("digit", [], {"digit": "4"}),
    }
    print(describe_machine())
    command = [sys.executable, "-u", "-c", "from sextant.cli import main; main()", "demo", "browser=false"]
    began = time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        found = re.search(r"http://\S+", server.stdout.readline())
        assert found is not None
        address = found[0]
        with urlopen(address) as page:
            page.read()
        print(f"from the command to the page: {time.perf_counter() - began:.1f} s")
        for name, question in questions.items():
            first, *more = (ask(address, *question) for _ in range(1 + AGAIN))
            print(f"{name}: {first:.2f} s at first, then {statistics.median(more):.2f} s")
        server.send_signal(signal.SIGINT)
        print(f"Ctrl-C ends it with status {server.wait()}")


if __name__ == "__main__":
    main()
