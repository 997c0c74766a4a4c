"""Memory and processor time of a served page until its first load: VmHWM and VmRSS in MB, s.

python -m benchmarks.served results/example
"""

import os
import re
import subprocess
import sys
import urllib.request


def memory_mb(pid):
    """Return the largest and the present memory of a process (Linux)."""
    with open(f"/proc/{pid}/status", encoding="ascii") as file:
        text = file.read()
    return [int(re.search(rf"{name}:\s+(\d+)", text)[1]) / 1000 for name in ("VmHWM", "VmRSS")]


def cpu_s(pid):
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().split()
    return (int(fields[13]) + int(fields[14])) / os.sysconf("SC_CLK_TCK")


def main(study):
    command = [sys.executable, "-m", "dse", "dashboard", study, "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        url = next(found[0] for line in server.stdout if (found := re.search(r"http://\S+", line)))
        print("started ", memory_mb(server.pid), cpu_s(server.pid))
        size = len(urllib.request.urlopen(url).read())
        print("loaded  ", memory_mb(server.pid), cpu_s(server.pid), f"{size / 1e6:.1f} MB sent")
        server.terminate()


if __name__ == "__main__":
    main(*sys.argv[1:])
