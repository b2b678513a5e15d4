"""Makes the recordings in this folder again, frame for frame: `python recordings/make.py`."""

from pathlib import Path

from service.cli.simulate import simulate

SPANS = {"wedges": 15.0, "objects": 30.0}
"""Scene → how far the poses reach, end to end, in pixels."""

if __name__ == "__main__":
    for scene, span in SPANS.items():
        simulate(Path(__file__).with_name(f"{scene}.mcap"), scene=scene, frames=15, span=span, force=True)
