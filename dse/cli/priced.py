"""Options of the commands that compute costs: on which hardware, and on what duty cycle."""

from __future__ import annotations

import argparse

from dse.cli.numbers import amount


def add_hardware(parser: argparse.ArgumentParser) -> None:
    """Declare `--hardware`."""
    parser.add_argument(
        "--hardware",
        action="append",
        default=[],
        metavar="NAME",
        help="price the points on this profile, or file of one, without training; repeatable",
    )


def add_duty(parser: argparse.ArgumentParser) -> None:
    """Declare `--contacts-per-hour` and `--battery-mwh`."""
    parser.add_argument(
        "--contacts-per-hour",
        type=amount,
        metavar="N",
        help="column power_mw: mean power of so many inferences an hour, at the sensor's period, and idling",
    )
    parser.add_argument(
        "--battery-mwh",
        type=amount,
        metavar="M",
        help="with --contacts-per-hour, column battery_h: how long a battery of so much lasts",
    )
