"""The whole of dse in one file of plain numpy, for the designs of search_spaces/quickstart.yaml alone.

    python docs/core.py search_spaces/quickstart.yaml 0 training.epochs=2 bundle.npz

A space becomes events of a simulated fingertip, spikes, a trained network, a bundle, its measures and a
front, with the same bits as `dse`, of which nothing is imported: numbers of textures, sensors and chips are
read from its YAML files. Sections follow the data's way; docs/core.md is the guide.
"""

import ctypes.util
import hashlib
import itertools
import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import yaml

ROOT = Path(__file__).resolve().parent.parent
F32 = np.float32
GRID = F32(32)  # 8-bit weights are whole numbers over this


def refuse(what):
    """Stop with one line: this program knows the designs of the quickstart alone."""
    raise SystemExit(f"core: {what}")


# ==== 1. The search space: a YAML file whose choices span a grid of designs (dse/config, dse/search) ====

FIXED = "data.kind", "preprocessing.polarity", "model.kind", "model.recurrent", "search.sampler"
# Keys that the quickstart leaves at their defaults.
FALSE_RATE = 0.02  # spikes per step that an output is to send for other classes
TAU_GRAD, SCALE_GRAD = 0.03, 3.0  # width (in 100 thresholds) and height of the hidden surrogate gradient
BATCH, LR_FACTOR = 32, 0.67
CHUNK_ROWS = 4096  # samples times steps whose gradients are summed together, at most
READ_OUTS = 20  # input lengths, evenly spaced, after which a network is read out


def read_yaml(*place):
    """Return what a YAML file of the repository holds."""
    return yaml.safe_load(ROOT.joinpath(*place).read_text(encoding="utf-8"))


def read_space(path, overrides=()):
    """Return the settings of a space, {dotted key: value}; overrides are texts such as training.epochs=2."""

    def flat(sections):
        parts = [(k, x) if isinstance(x, dict) else ("", {k: x}) for k, x in sections.items()]
        return {f"{part}.{key}".lstrip("."): value for part, keys in parts for key, value in keys.items()}

    known, settings = flat(read_yaml("search_spaces/quickstart.yaml")), flat(read_yaml(Path(path).resolve()))
    settings |= {name: yaml.safe_load(value) for name, value in (text.split("=") for text in overrides)}
    for name, value in settings.items():
        if name not in known:
            refuse(f"{path}: {name} is unknown; known are {', '.join(known)}")
        if name in FIXED and value != known[name]:
            refuse(f"{path}: {name} must be {known[name]}, got {value}")
    return settings


def designs_of(settings):
    """Return every design, the choices that it makes: the last choice in the file changes fastest."""
    axes = {name: x["choice"] for name, x in settings.items() if isinstance(x, dict) and "choice" in x}
    return [dict(zip(axes, one, strict=True)) for one in itertools.product(*axes.values())]


# ==== 2. Random numbers: one generator per (seed, what it belongs to, purpose), so that no order matters ====


def generator(seed, owner, purpose, *index):
    """Return a counter-based generator; its key is a hash of the text of the arguments (base/seeds.py)."""
    of_owner = json.dumps(owner, sort_keys=True, separators=(",", ":"))
    text = "\x1f".join([str(seed), of_owner, purpose, *map(str, index)])
    key = np.frombuffer(hashlib.sha256(text.encode()).digest()[:16], np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def splitmix(key, counter):
    """Return 64 random bits for each counter (n,) of a key: numbers that any pixel or event can ask for."""
    z = np.uint64(key) + (counter.astype(np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def unit(bits):
    """Return random bits as numbers in (0, 1)."""
    return ((bits >> np.uint64(12)).astype(np.int64) + 0.5) * 2.0**-52


def of_c_library(name):
    """Return a float32 function of the C library, over arrays: numpy's own differs in its last bit."""
    function = getattr(ctypes.CDLL(ctypes.util.find_library("m")), name)
    function.restype, function.argtypes = ctypes.c_float, [ctypes.c_float]
    return lambda x: np.fromiter(map(function, x.tolist()), F32, len(x))


expf, logf = of_c_library("expf"), of_c_library("logf")

# ==== 3. The scene: a soft tip with pins slides over textures (dse/scene) ====

SCENE_SEED, FORCE_N = 0, 1.51
STEP_S = 1e-4  # of friction
TEXTURE_STEPS, CAMERA_STEPS = 5, 20  # friction steps per step of the texture filter, and of the camera
N_GRID, GRID_MM = 512, 0.1  # points along a side of a texture's periodic patch, and their distance
LINE_POINTS, POINTS_PER_LENGTH = 4096, 8  # friction roughness along the path
SKIP2_PX2, TURN2_PX2 = 0.1 * 0.1, 0.02 * 0.02  # from here on a pin is looked at, or seen to have turned
OLDEST_US = 32000.0  # no event is older when it is sent
SETTLED_MM, STILL_PX2 = 1e-6, 1e-12
TABLE = 8192  # entries of the camera's tables
STRIP = np.arange(16)  # a look searches a square of 16 pixels a side
FX, FY = np.fft.rfftfreq(N_GRID, GRID_MM)[None], np.fft.fftfreq(N_GRID, GRID_MM)[:, None]  # 1/mm


def read_scene(name):
    """Return a scene of search_spaces/scenes: the numbers of its sensor, its textures, its trials (cells)."""
    scene, sensors = read_yaml("search_spaces", "scenes", f"{name}.yaml"), read_yaml("dse/scene/sensors.yaml")
    if set(scene) != {"scene", "sensor", "textures", "motions", "trials", "duration_ms"}:
        refuse(f"scene {name}: keys {sorted(scene)} are not those of the quickstart's")
    common, own = sensors["common"], sensors["sensors"][scene["sensor"]]
    numbers = [*(common["sensor"] | own["sensor"]).items(), *(common["camera"] | own["camera"]).items()]
    sensor = {key: number["value"] for key, number in numbers}
    if (sensor["layout"], sensor["lens_per_mm2"], sensor["incipient_slip"]) != ("grid", 0, False):
        refuse(f"sensor {scene['sensor']}: only a grid of pins without lens and incipient slip is known")
    motions, known = [], read_yaml("dse/scene/textures.yaml")["textures"]
    for motion in scene["motions"]:
        key = "speed_mm_s" if motion["kind"] == "constant" else "peak_mm_s"
        for speed in motion[key]["choice"] if isinstance(motion[key], dict) else [motion[key]]:
            motions.append({**motion, "speed_mm_s": speed, "label": f"{motion['kind']}_{speed:g}"})
    textures = [{"name": x, "grain": 1.0, **known[x]} for x in scene["textures"]]
    cells = list(itertools.product(textures, motions, range(scene["trials"])))
    return SimpleNamespace(**sensor, textures=textures, cells=cells, duration_s=scene["duration_ms"] / 1000)


def of_trial(cell, purpose):
    """Return the generator of one purpose of a trial, (texture, motion, repetition), and of no other."""
    owner = {"texture": cell[0]["name"], "motion": cell[1]["label"], "force_n": FORCE_N}
    return generator(SCENE_SEED, owner, purpose, cell[2])


def standardised(x):
    """Return x with mean 0 and variance 1."""
    x = x - x.mean()
    return x / x.std()


def shaped(rng, gain):
    """Return a patch of noise of a gain in the frequency domain, standardised."""
    return standardised(np.fft.irfft2(np.fft.rfft2(rng.standard_normal((N_GRID, N_GRID))) * gain))


def surface_of(texture, scene):
    """Return the slopes (row, column, axis) that pins feel, and the friction roughness (n,) (surface.py).

    Heights are noise of gain |H(f)| = f'^(-1/2) exp(-log2(f' wavelength)^2 / (2 bandwidth^2)), f' stretched
    along y by the grain, and a share of two crossed gratings. The skin passes exp(-2 pi f depth), and a pin
    averages with a Gaussian. The roughness is noise that is correlated over half a wavelength.
    """
    rng = generator(SCENE_SEED, {"texture": texture["name"]}, "surface")
    f = np.hypot(FX, texture["grain"] * FY)
    f[0, 0] = 1.0
    octaves, width = np.log2(f * texture["wavelength_mm"]), texture["bandwidth_oct"]
    gain = f**-0.5 * np.exp(-(octaves**2) / (2 * width**2))
    gain[0, 0] = 0.0
    height = shaped(rng, gain)
    if share := texture.get("weave_share"):
        height = np.sqrt(1 - share) * height + np.sqrt(share) * standardised(weave(texture, rng))
    height, f = standardised(height) * texture["rms_um"] * 1e-3, np.hypot(FX, FY)
    skin = np.exp(-2 * np.pi * f * scene.depth_mm - (2 * np.pi * f * scene.pin_average_mm) ** 2 / 2)
    slope = [np.fft.irfft2(2j * np.pi * axis * (np.fft.rfft2(height) * skin)) for axis in (FX, FY)]
    gain = np.exp(-((np.pi * np.fft.rfftfreq(LINE_POINTS) * POINTS_PER_LENGTH) ** 2) / 2)
    gain[0] = 0.0
    line = np.fft.irfft(np.fft.rfft(rng.standard_normal(LINE_POINTS)) * gain)
    return np.stack(slope, axis=-1).astype(F32), standardised(line)


def weave(texture, rng):
    """Return two crossed gratings whose waves fit the patch, their phases straying over 10 mm."""
    (y, x), period, woven = np.mgrid[:N_GRID, :N_GRID] / N_GRID, texture["weave_period_mm"], 0.0
    slow = np.exp(-((np.pi * np.hypot(FX, FY) * 10.0) ** 2) / 2)
    slow[0, 0] = 0.0
    for turn, amplitude in ((0.0, 1.0), (np.pi / 2, 0.6)):
        angle = np.deg2rad(texture["weave_angle_deg"]) + turn
        kx, ky = (round(N_GRID * GRID_MM / period * wave(angle)) for wave in (np.cos, np.sin))
        woven = woven + amplitude * np.cos(2 * np.pi * (kx * x + ky * y) + 0.5 * shaped(rng, slow))
    return woven


def draw_trial(scene, cell):
    """Return what one trial draws, and what follows from it before time begins (trial.py, contact.py).

    Contact after Hertz: a = (3 F R / (4 E*))^(1/3), 1 / E* = 1 / E_tip + 1 / E_texture. A pin at r reads the
    texture with sqrt(1 - (r / a)^2), and is sheared by a share that is 1 inside a and falls to 0 at the rim.
    """
    texture, rng = cell[0], of_trial(cell, "trial")
    normal = rng.standard_normal(8)
    x0, y0, hz, phase = rng.uniform(-1, 1, 4)
    offset_px = rng.standard_normal(2) * 0.4  # of the image as mounted, which is turned by a degree or so
    force_n = max(0.0, FORCE_N + float(np.clip(normal[0] * 0.20, -0.5, 0.5)))  # at most 0.5 N off
    friction, tip_mpa = float(np.exp(normal[1] * 0.05)), scene.modulus_mpa * float(np.exp(normal[2] * 0.08))
    line = (np.arange(scene.n_across) - (scene.n_across - 1) / 2) * scene.pin_pitch_mm
    y, x = np.meshgrid(line, line, indexing="ij")
    sin, cos = np.sin(np.deg2rad(normal[3])), np.cos(np.deg2rad(normal[3]))
    pins_mm = np.stack([x.ravel(), y.ravel()], axis=1) @ np.array([[cos, -sin], [sin, cos]]).T
    r, rim, mpa = np.hypot(pins_mm[:, 0], pins_mm[:, 1]), scene.rim_mm, texture["modulus_mpa"]
    a = min((3 * force_n * scene.dome_radius_mm / (4 * (1 / (1 / tip_mpa + 1 / mpa)))) ** (1 / 3), rim)
    drawn = SimpleNamespace(pins_mm=pins_mm, radius_mm=a, force_n=force_n)
    drawn.pressure = np.sqrt(np.clip(1 - (r / a) ** 2, 0, None))
    drawn.shear = np.where(r <= a, 1.0, np.clip((rim - r) / (rim - a), 0, 1))
    drawn.middle_px = np.array(scene.frame_px) / 2 + offset_px - 0.5
    drawn.start_mm = np.array([x0 * 5.0, y0 * 2.5])  # where on the texture, along and across the motion
    drawn.drift = float(normal[4] * 0.06)  # of the force, relative, over the record
    drawn.tilt_mm = scene.lever_mm * mpa / (mpa + tip_mpa)  # travel of a pin's tip per slope
    drawn.mu = texture["mu_static"] * friction, texture["mu_kinetic"] * friction
    drawn.onset_s = 1e-3 * (30.0 + abs(float(normal[5])) * 8.0)  # of the motion
    drawn.gain = float(np.exp(normal[6] * 0.02))  # of the speed
    drawn.ripple = 0.05 * abs(float(normal[7])), 8.0 + (22.0 - 8.0) * (hz + 1) / 2, np.pi * phase  # share, Hz
    drawn.normals, drawn.key = rng.standard_normal(1024), int(rng.integers(2**63))
    return drawn


def speed_of(motion, drawn, t_s):
    """Return the speed of the tip at times of the record, mm/s: the profile with its gain and its ripple."""
    t, peak, travel = t_s - drawn.onset_s, motion["speed_mm_s"], motion["travel_mm"]
    duration = 2 * travel / peak
    if motion["kind"] == "constant":  # after a ramp of 300 mm/s2
        reached = min(peak, math.sqrt(2 * 300.0 * travel))
        v, duration = np.minimum(300.0 * t, peak), travel / reached + reached / (2 * 300.0)
    elif motion["kind"] == "accelerating":
        v = peak * t / duration
    elif motion["kind"] == "triangular":
        v = 2 * peak * np.clip(np.minimum(t / duration, 1 - t / duration), 0, None)
    else:
        refuse(f"motion {motion['kind']} is unknown; known are constant, accelerating, triangular")
    v, (share, hz, phase) = np.where((t >= 0) & (t <= duration), v, 0.0), drawn.ripple
    return np.maximum(0.0, drawn.gain * v * (1 + share * np.sin(2 * np.pi * hz * t_s + phase)))


def travel_of(texture, drawn, line, speeds, forces, stiffness):
    """Return deflection s of the skin and slip distance X at the ends of friction steps, mm (friction.py).

    Both phases are exact within a step, and may end within it:
    stick  ds/dt = v  until  k s > mu* F rho(X),   rho = 1 + roughness n(X)
    slip   ds/dt = (s_k - s) / 2 ms  until s is within 15 % of the drop; then stick, with a threshold drawn
           mu* = mu_k + (mu_s - mu_k) e^(-v / v_s) e^(jitter n) + 0.004
    """
    (mu_s, mu_k), tau_s = drawn.mu, 0.002
    line_mm, line, n_slips = texture["wavelength_mm"] / 2 / POINTS_PER_LENGTH, line.tolist(), 0
    s, x, drop, slipping, threshold, path = 0.0, 0.0, 0.0, False, mu_s, [(0.0, 0.0)]
    for v, force in zip(speeds.tolist(), forces.tolist(), strict=True):
        low = math.floor(x / line_mm)
        part = x / line_mm - low
        n = (1 - part) * line[low % LINE_POINTS] + part * line[(low + 1) % LINE_POINTS]
        fades = (mu_s - mu_k) * math.exp(-v / texture["stribeck_mm_s"])
        reach = force * max(0.0, 1 + texture["friction_roughness"] * n) / stiffness
        s_k, left = max(0.0, (mu_k - fades / 2) * reach), STEP_S
        while True:
            if not slipping:
                room = threshold * reach - s
                if room >= v * left:
                    s += v * left
                    break
                used = room / v if room > 0 else 0.0
                s, left = s + v * used, left - used
                drop = s - s_k
                slipping = drop > 0
                if not slipping:  # nothing holds the skin
                    x += v * left
                    break
            else:
                over, ends = s - s_k, 0.15 * drop
                if over > ends:
                    used = tau_s * math.log(over / ends)
                    if used > left:
                        s = s_k + over * math.exp(-left / tau_s)
                        x += v * left - (s - s_k - over)
                        break
                    s = s_k + ends
                    x, left = x + (v * used - (s - s_k - over)), left - used
                jitter = math.exp(texture["slip_jitter"] * drawn.normals[n_slips % 1024])
                slipping, threshold, n_slips = False, mu_k + fades * jitter + 0.004, n_slips + 1
        path.append((s, x))
    return np.array(path).T


class Pins:
    """The moving pins of a trial, those of the contact first (tip.py, movement.py).

    A pin whose place at rest is p stands at p (1 + spread drift) - shear s e_x + f; f follows T, what the pin
    reads of the texture at X, through the filter of skin and gel.
    """

    def __init__(self, scene, drawn, slope):
        reads = np.flatnonzero(drawn.pressure > 0)
        self.order = np.concatenate([reads, np.flatnonzero((drawn.shear > 0) & (drawn.pressure <= 0))])
        self.n, self.n_contact = len(self.order), len(reads)
        self.rest, self.shear = drawn.pins_mm[self.order], drawn.shear[self.order]
        self.spread = 0.03 * drawn.drift * np.exp(-(self.rest**2).sum(axis=1) / drawn.radius_mm**2)
        self.scale, self.middle_px = scene.image_scale_px_mm, drawn.middle_px
        self.start_mm = drawn.start_mm[0] + self.rest[: self.n_contact, 0]
        # Rows of the texture stay the same: each pin reads one line of it.
        place = (self.rest[: self.n_contact, 1] + drawn.start_mm[1]) / GRID_MM
        row, part = np.floor(place).astype(int), (place - np.floor(place)).astype(F32)[:, None, None]
        low, high = slope[row % N_GRID], slope[(row + 1) % N_GRID]
        factor = (-drawn.tilt_mm * drawn.pressure[reads]).astype(F32)[:, None, None]
        self.lines = factor * (low + part * (high - low))

    def read(self, x):
        """Return what the pins of the contact read at a slip distance, (pin, 2) mm."""
        place, pins = (x + self.start_mm) / GRID_MM, np.arange(self.n_contact)
        column = np.floor(place).astype(int)
        here, there = self.lines[pins, column % N_GRID], self.lines[pins, (column + 1) % N_GRID]
        return here + (place - np.floor(place))[:, None] * (there - here)

    def place(self, s, f, drift):
        """Return the image centres of the pins, (pin, 2) px."""
        at = self.rest * (1 + self.spread * drift)[:, None]
        at[:, 0] -= self.shear * s
        at[: self.n_contact] += f
        return self.middle_px + self.scale * at


def walk(pins, camera, s, x, corner_hz, duration_us):
    """Move the pins from mark to mark, and let the camera look at those for which it is due (movement.py).

    Marks are every step of the texture filter, the last step, and where the skin turns. A look is due where a
    pin turned since its last one, is further than 0.1 px from it, or comes to rest, or where that is old. The
    filter f[k+1] = e f[k] + c0 T[k] + c1 T[k+1] is a low pass, exact for a T that is linear between.
    """
    d, last, constants = np.diff(s), len(s) - 1, [None]
    turning = np.flatnonzero(d[:-1] * d[1:] < 0) + 1
    marks = sorted({*range(TEXTURE_STEPS, last, TEXTURE_STEPS), *turning.tolist(), last})
    for n_steps in range(1, TEXTURE_STEPS + 1):
        angle = 2 * np.pi * corner_hz * (n_steps * STEP_S)
        e, mean = float(np.exp(-angle)), -float(np.expm1(-angle)) / angle
        constants.append((e, mean - e, 1 - mean))
    f = reads = pins.read(x[0])
    looked_px = pins.place(0.0, f, 0.0)  # where the last look found each pin
    camera.start(pins.order, looked_px)
    mark_px, mark_d2, looked_us = looked_px.copy(), np.zeros(pins.n), np.zeros(pins.n)
    r = np.sqrt(pins.rest[:, 0] ** 2 + pins.rest[:, 1] ** 2)
    drift_px_us = (pins.scale * abs(pins.spread) * r / duration_us).max()
    settled, moved, drifted_us, before_us, before = True, False, 0.0, 0.0, 0
    for mark, turns in zip(marks, np.isin(marks, turning), strict=True):
        ends = mark == last
        on_grid, t_us = mark % CAMERA_STEPS == 0 or ends, min(mark * (1e6 * STEP_S), duration_us - 0.5)
        slides = x[mark] != x[before]
        if slides or not settled:
            (e, c0, c1), end = constants[mark - before], pins.read(x[mark]) if slides else reads
            f, reads = e * f + c0 * reads + c1 * end, end
            settled = not slides and abs(end - f).max(initial=0.0) < SETTLED_MM
        moves = slides or not settled or s[mark] != s[before]
        stops = moved and not moves
        if moves or stops or ends or (on_grid and (t_us - drifted_us) * drift_px_us > 0.1):
            n = pins.n if on_grid or turns or stops else pins.n_contact
            at, drifted_us = pins.place(s[mark], f, t_us / duration_us)[:n], t_us
            d2 = ((at - looked_px[:n]) ** 2).sum(axis=1)
            turned = (d2 < mark_d2[:n]) & (mark_d2[:n] > TURN2_PX2)
            far = d2 > SKIP2_PX2
            if not on_grid:  # pins outside the contact turn where the skin does
                far = (d2 > TURN2_PX2) & turns & (np.arange(n) >= pins.n_contact)
            old = on_grid & (t_us - looked_us[:n] >= OLDEST_US)
            late = (old | stops | ends) & (d2 > STILL_PX2)
            due = turned | far | late
            looked_us[:n][old & ~due] = t_us
            for back in (turned, np.zeros(n, bool)):  # where it turned, at the mark before; then where it is
                chosen, back = np.flatnonzero(due), back[due]
                to = np.where(back[:, None], mark_px[chosen], at[chosen])
                now_us = np.where(back, before_us, t_us)
                since_us = np.maximum(looked_us[chosen], now_us - OLDEST_US)
                if chosen.size:
                    camera.look(pins.order[chosen], to, since_us, now_us)
                looked_px[chosen], looked_us[chosen] = to, now_us
                d2 = ((at - looked_px[:n]) ** 2).sum(axis=1)
                due = turned & ((on_grid & (d2 > SKIP2_PX2)) | (late & (d2 > STILL_PX2)))
            mark_px[:n], mark_d2[:n] = at, d2
        moved, before_us, before = moves, t_us, mark


class Camera:
    """Pixels that send an event when the logarithm of their light has changed by a threshold (camera.py).

    Light at distance d of a pin: I = b + (1 - b) / (1 + exp((d - radius) / edge)), b = 1 / contrast.
    A pixel sends ON at ln I >= L + theta_on, and L rises by theta_on; OFF alike. I falls with d: a level is a
    distance, and each pixel keeps the squares of its two next ones. L begins within one threshold of ln I.
    """

    def __init__(self, scene, drawn):
        (self.width, self.height), self.scene, self.key = scene.frame_px, scene, drawn.key
        radius, edge = scene.pin_radius_mm * scene.image_scale_px_mm, scene.edge_px
        self.disc, self.black = radius + 6.2 * edge, 1 / scene.contrast
        # Tables: share of white over squared distance, squared distance over light.
        self.per_px2, self.per_light = (TABLE - 1) / (self.disc + 1) ** 2, (TABLE - 1) / (1 - self.black)
        self.white = 1 / (1 + np.exp((np.sqrt(np.arange(TABLE) / self.per_px2) - radius) / edge))
        self.top = self.black + (1 - self.black) / (1 + np.exp(-radius / edge))
        share = np.clip(np.arange(TABLE) / (TABLE - 1), 1e-5, 1 - 1e-5)
        self.distance2 = (np.maximum(0.0, radius - edge * np.log(share / (1 - share))) ** 2).astype(F32)
        normal = generator(SCENE_SEED, {}, "camera").standard_normal((self.height, self.width, 2))
        theta = np.maximum(0.02, scene.threshold * np.exp(scene.mismatch * normal)).astype(F32)
        self.theta = theta.reshape(-1, 2)  # OFF, ON
        self.off, self.on = np.exp(theta * np.array([-1.0, 1.0], F32)).reshape(-1, 2).T
        # State, by pixel; a level e^L of 0 is that of a pixel that no pin has lit yet.
        self.near, self.far, self.level, self.last_us = np.zeros((4, self.width * self.height), F32)
        self.near[:], self.far[:], self.last_us[:] = np.inf, np.inf, -np.inf
        self.events, self.at_px = [], drawn.middle_px + scene.image_scale_px_mm * drawn.pins_mm

    def start(self, pins, at_px):
        """Place the moving pins, and light the pixels of all discs."""
        self.at_px[pins] = at_px
        y, x = np.mgrid[: self.height, : self.width].reshape(2, -1)
        for px, py in self.at_px:
            d2 = (x - px) ** 2 + (y - py) ** 2
            pixel = np.flatnonzero(d2 <= self.disc * self.disc)
            place = d2[pixel] * self.per_px2
            k = np.minimum(place.astype(int), TABLE - 2)
            self.begin(pixel, self.white[k] + (place - k) * (self.white[k + 1] - self.white[k]))

    def begin(self, pixel, white):
        """Set pixels to the state of t = 0 under a share of white."""
        phase = 2 * unit(splitmix(self.key, pixel)) - 1
        theta = self.theta[pixel, (phase <= 0).astype(int)]
        light = self.black + (1 - self.black) * np.minimum(1.0, white)
        level = np.clip(light * expf(phase.astype(F32) * theta), self.black, 1.0)
        self.level[pixel] = level
        self.near[pixel], self.far[pixel] = self.next(level * self.on[pixel], level * self.off[pixel])

    def next(self, up, down):
        """Return the squared distances below which a pin gives a light of `up`, and beyond which `down`."""
        light = np.stack([up, down]).astype(np.float64)
        place = np.maximum(0.0, (light - self.black) * self.per_light)
        k = np.minimum(place.astype(int), TABLE - 2)
        d2 = self.distance2[k] + (place - k).astype(F32) * (self.distance2[k + 1] - self.distance2[k])
        d2[0, light[0] >= self.top], d2[1, light[1] <= self.black] = -1, np.inf  # never
        return d2

    def look(self, pins, to, since_us, until_us):
        """Move pins straight to new places, a pixel at a time, and send what pixels in their discs see."""
        start, step = self.at_px[pins], to - self.at_px[pins]
        n_legs = np.maximum(1, np.ceil(np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2)).astype(int))
        self.at_px[pins] = to
        apart2 = ((to[:, None] - self.at_px) ** 2).sum(axis=2)
        if (apart2 < (2 * self.disc + 1) ** 2).sum() > len(pins):
            refuse("images of two pins overlap, which does not happen in the quickstart's scene")
        first, way = np.column_stack([start, since_us]), np.column_stack([step, until_us - since_us])
        for leg in range(n_legs.max()):
            on = leg < n_legs
            before, after = (first[on] + (k / n_legs[on])[:, None] * way[on] for k in (leg, leg + 1))
            x, y, _ = after.T
            column, row = (np.ceil(c - self.disc).astype(int)[:, None] + STRIP for c in (x, y))
            dx = STRIP.astype(F32) + (column[:, 0] - x).astype(F32)[:, None]
            gy = row - y[:, None]
            d2 = (dx * dx)[:, None, :] + (gy * gy).astype(F32)[:, :, None]
            in_rows = (row <= np.floor(y + self.disc)[:, None]) & (row >= 0) & (row < self.height)
            inside = in_rows[:, :, None] & ((column >= 0) & (column < self.width))[:, None, :]
            pixel = np.where(inside, row[:, :, None] * self.width + column[:, None, :], 0)
            crossed = (self.near[pixel] > d2) | (d2 > self.far[pixel])
            pin, i, j = np.nonzero(inside & crossed & (F32(self.disc * self.disc) > d2))
            self.send(column[pin, j], row[pin, i], *before[pin].T, *after[pin].T)

    def send(self, x, y, x0, y0, t0, x1, y1, t1):
        """Send the events of pixels (x, y) whose pin went from (x0, y0) to (x1, y1) between two times, us."""
        pixel = y * self.width + x
        new = pixel[self.level[pixel] == 0]
        self.begin(new, np.zeros(new.size))
        gx, gy, hx, hy = x - x1, y - y1, x - x0, y - y0
        d2, d2_before = (gx * gx + gy * gy).astype(F32), hx * hx + hy * hy
        near, far, level, off, on = (a[pixel] for a in (self.near, self.far, self.level, self.off, self.on))
        rate = np.divide(t1 - t0, d2 - d2_before, out=np.zeros(pixel.size), where=d2 != d2_before)
        is_on, live = d2 <= near, ~((near < d2) & (d2 < far))
        while live.any():
            t = np.minimum(t1, np.maximum(t0, t0 + (np.where(is_on, near, far) - d2_before) * rate))
            sent = live & (t - self.last_us[pixel] >= self.scene.refractory_us)
            self.last_us[pixel[sent]] = t[sent]
            self.events.append(np.stack([t[sent].astype(int), x[sent], y[sent], is_on[sent]], axis=1))
            level = np.where(live, level * np.where(is_on, on, off), level)
            near_now, far_now = self.next(level * on, level * off)
            passed = np.where(is_on, near_now < d2, far_now > d2)
            near = np.where(live & (is_on | passed), near_now, near)
            far = np.where(live & (~is_on | passed), far_now, far)
            live &= ~passed
        self.level[pixel], self.near[pixel], self.far[pixel] = level, near, far


def background(scene, cell):
    """Return background events (n, 4) t, x, y, polarity: exponential gaps, places and polarities uniform."""
    (width, height), duration_us = scene.frame_px, round(scene.duration_s * 1e6)
    key, per_us = int(of_trial(cell, "background").integers(2**63)), scene.noise_hz * width * height * 1e-6
    n = np.arange(int(per_us * duration_us + 8 * np.sqrt(per_us * duration_us)) + 64)  # never too few
    gaps_us = logf(unit(splitmix(key, 2 * n)).astype(F32)).astype(np.float64) * (1 / per_us)
    t, z = np.add.accumulate(-gaps_us), splitmix(key, 2 * n + 1)
    place = [(z >> np.uint64(first_bit)) & np.uint64(0xFFFFFF) for first_bit in (40, 16)]
    x, y = (at.astype(np.int64) * size * 2.0**-24 for at, size in zip(place, (width, height), strict=True))
    return np.stack([t, x, y, z & np.uint64(1)], axis=1).astype(np.int64)[t < duration_us]


def events_of(scene, cell, surface):
    """Return the events (n, 4) of a trial: t in us, x, y, polarity, sorted by time, row, column, polarity."""
    (texture, motion, _), (slope, line), drawn = cell, surface, draw_trial(scene, cell)
    middle_s = (np.arange(round(scene.duration_s / STEP_S)) + 0.5) * STEP_S
    force = drawn.force_n * (1 + drawn.drift * middle_s / scene.duration_s)
    s, x = travel_of(texture, drawn, line, speed_of(motion, drawn, middle_s), force, scene.stiffness_n_mm)
    camera = Camera(scene, drawn)
    walk(Pins(scene, drawn, slope), camera, s, x, scene.corner_hz, 1e6 * scene.duration_s)
    events = np.concatenate([*camera.events, background(scene, cell)])
    return events[np.lexsort((events[:, 3], events[:, 1], events[:, 2], events[:, 0]))]


# ==== 4. Spikes (dse/data): pools of pixels, bins of time (preprocessing); parts of the split (dataset) ====


def spikes_of(events, space, scene):
    """Return the spikes (step, channel) bool of a trial: pools, row by row, with enough events in a bin."""
    pool, bin_us = space["preprocessing.pool"], round(space["preprocessing.bin_ms"] * 1000)
    n_steps, across = round(scene.duration_s * 1e6) // bin_us, scene.frame_px[0] // pool
    n_channels = across * (scene.frame_px[1] // pool)
    channel = events[:, 2] // pool * across + events[:, 1] // pool
    counts = np.bincount(events[:, 0] // bin_us * n_channels + channel, minlength=n_steps * n_channels)
    return counts.reshape(n_steps, n_channels) >= space["preprocessing.pool_threshold"]


def prepare(space):
    """Return spikes (sample, step, channel), labels (names, class of each sample) by target, both parts."""
    scene, data = read_scene(space["data.scene"]), SimpleNamespace(step_ms=space["preprocessing.bin_ms"])
    surfaces = {texture["name"]: surface_of(texture, scene) for texture in scene.textures}
    of_cells = (events_of(scene, cell, surfaces[cell[0]["name"]]) for cell in scene.cells)
    data.spikes = np.array([spikes_of(events, space, scene) for events in of_cells])
    texture, profile, repetition = zip(*((x["name"], y["label"], k) for x, y, k in scene.cells), strict=True)
    columns = {"texture": texture, "profile": profile}
    data.labels = {name: np.unique(column, return_inverse=True) for name, column in columns.items()}
    parts = (np.isin(repetition, space[f"split.{x}"]["repetition"]) for x in ("train", "validation"))
    data.train, data.validation = map(np.flatnonzero, parts)
    return data


def later(spikes, steps=1):
    """Return spikes (sample, step, neuron) so many steps later; what would come after the end is lost."""
    out = np.zeros_like(spikes)
    out[:, steps:] = spikes[:, : spikes.shape[1] - steps]
    return out


def inputs_of(spikes, delays):
    """Return spikes (sample, step, channel) with a copy of all channels per delay."""
    return np.concatenate([later(spikes, delay) for delay in delays], axis=2)


# ==== 5. The network (dse/engine, neurons/cuba_lif.py in it): a recurrent hidden layer, then the outputs ====
#     u[t] = trunc(u[t-1] (4096 - d_u) / 4096) + trunc(4096 z[t])         current; z: weighted spikes
#     v[t] = trunc(v[t-1] (4096 - d_v) / 4096) + u[t]                     potential before the reset
#     s[t] = v[t] > threshold;   v = 0 where it spikes                    u is not reset
# States are whole numbers, units 1/4096; weights are q / 32, q in int8. Spikes reach the next layer, and the
# layer itself, one step later. Sums of weights are whole numbers: their order is free.


def rounded(weights):
    """Return float32 weights as the whole numbers q that run, float32."""
    return np.clip(np.rint(weights.astype(F32) * GRID), F32(-128), F32(127))


def clipped(weights):
    """Return weights within the range of 8 bits, float32: beyond it they have no gradient."""
    return np.clip(weights.astype(F32), F32(-4), F32(127 / 32))


def drive_of(spikes, whole, unit=1 / 32):
    """Return 4096 z of spikes (sample, step, input), truncated; z: sums of whole weights times a unit."""
    z = (spikes.reshape(-1, len(whole)).astype(F32) @ whole.astype(F32)) * F32(unit)
    return (z * F32(4096)).astype(np.int64).reshape(*spikes.shape[:2], -1)


def leak(x, decay):
    """Return whole numbers after a step of leak, rounded toward zero."""
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)


def run(drive, decays, threshold, ring=None):
    """Return spikes, potentials before reset (1/4096), which neurons are updated, and the largest state.

    A neuron is updated in a step in which it has a potential or an input. All are (sample, step, neuron); the
    drive is that of `drive_of`; `ring` are whole recurrent weights, (neuron, neuron), row = presynaptic.
    """
    spikes, updated, potential = (np.zeros(drive.shape, kind) for kind in (bool, bool, np.int64))
    u, v, peak, ring = np.int64(0), np.int64(0), 0, None if ring is None else ring.astype(np.int64)
    for t in range(drive.shape[1]):
        z = drive[:, t] if ring is None or not t else drive[:, t] + 128 * (spikes[:, t - 1] @ ring)
        u = leak(u, decays[0]) + z
        v = potential[:, t] = leak(v, decays[1]) + u
        spikes[:, t], updated[:, t] = v > 64 * threshold, (v != 0) | (z != 0)
        v, peak = np.where(spikes[:, t], 0, v), max(peak, np.abs(u).max(), np.abs(v).max())
    return spikes, potential, updated, peak


def fma(a, b, c):
    """Return a b + c, rounded once to float32: a product of two float32 is exact in float64."""
    product = np.multiply(a, b, dtype=np.float64)
    total = product + c
    # Where the sum in float64 lies midway between two float32, what was lost decides.
    middle = (total.view(np.int64) & 0x1FFFFFFF) == 0x10000000
    if middle.any():
        part = total - product
        lost = (product - (total - part)) + (c - part)
        total = np.where(middle & (lost != 0), np.nextafter(total, np.copysign(np.inf, lost)), total)
    return total.astype(F32)


class Neurons:
    """CUBA-LIF neurons of a layer: decays (1/4096), threshold (1/64), and the surrogate gradient.

    ds/dv = height 2^(rate |v - centre|), a double exponential of width 100 tau_grad thresholds.
    """

    def __init__(self, own, n, kind, tau_grad, rng):
        self.n, self.threshold, self.decays = n, int(64 * own["model.threshold"]), np.zeros((2, n), np.int64)
        for row, name in zip(self.decays, ("current", "voltage"), strict=True):
            keep = 1 - np.atleast_1d(np.float64(own[f"model.{kind}{name}_decay"]))
            if keep.size > 1:  # two bounds: time constants are spread log-uniformly
                tau = -1 / np.log(np.clip(keep, 1e-9, 1 - 1e-6))
                keep = np.exp(-1 / np.exp(rng.uniform(*np.log(np.sort(tau)), n)))
            row[:] = np.clip(np.round(F32(4096) * (1 - keep).astype(F32)), 0, 4096)
        self.keep_u, self.keep_v = (4096 - self.decays) / 4096
        width = 100 * tau_grad * self.threshold / 64
        self.centre, self.rate = F32(self.threshold / 64 + 0.01 / 4096), F32(-math.log2(math.e) / width)
        self.height = F32(0.1 * SCALE_GRAD / (2 * width))

    def scale(self, n_steps):
        """Return the threshold over the root of the summed squared potential after one input spike, (n,)."""
        u, v, total = np.ones(self.n), np.zeros(self.n), 0.0
        for _ in range(n_steps):
            v = v * self.keep_v + u
            u, total = u * self.keep_u, total + v**2
        return self.threshold / 64 / np.sqrt(total)

    def slope(self, potential):
        """Return ds/dv at potentials (1/4096), float32: a power of 2 as a polynomial of its fraction."""
        x = np.maximum(np.abs((potential / 4096).astype(F32) - self.centre) * self.rate, F32(-100))
        whole, power = np.rint(x), F32(0.0013267)
        for factor in (0.00967546, 0.05550743, 0.24022122, 0.69314694, 1.0000001):
            power = fma(power, x - whole, F32(factor))
        return self.height * np.ldexp(power, whole.astype(int))


def neurons_of(space, design, data):
    """Return the hidden and output neurons of a design."""
    own, rng = space | design, generator(space["seed"], design, "time constants", 0)
    if not isinstance(own["model.hidden"], int):
        refuse(f"model.hidden must be the neurons of one layer, got {own['model.hidden']}")
    hidden = Neurons(own, own["model.hidden"], "", TAU_GRAD, rng)
    n_classes = len(data.labels[own["task.target"]][0])
    return hidden, Neurons(own, n_classes, "output_", own["model.output_tau_grad"], rng)


def reach_rate(fire, target, start):
    """Return the gain that comes closest to a spike rate from below: doubled from start / 16, then halved."""
    low, high, tried = start / 16, start / 16, []

    def is_below(gain):
        reached = fire(gain).mean()
        tried.append((abs(reached - target), gain))
        return reached < target

    while is_below(high) and high < start * 16:
        low, high = high, 2 * high
    for _ in range(6):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return min(tried)[1]


def initial_weights(inputs, own, hidden, outputs, rng):
    """Return the weights of the hidden layer, its ring and the outputs, float32 (input, neuron).

    Uniform weights are divided by each neuron's response, so that fast and slow ones are driven alike; a gain
    is searched for a spike rate on the inputs of a probe. Weights of outputs cancel over its mean input.
    """
    cells, n_steps, rate = inputs[..., 0].size, inputs.shape[1], own["model.initial_rate"]
    spread = math.sqrt(3 / max(1.0, np.count_nonzero(inputs) / cells))
    drawn = rng.uniform(-1, 1, (inputs.shape[2], hidden.n)) * hidden.scale(n_steps)
    drive = math.sqrt(3 / max(1.0, rate * hidden.n))
    ring = clipped(rng.uniform(-0.5, 0.5, (hidden.n, hidden.n)) * hidden.scale(n_steps) * drive)

    def fire(gain):
        return run(drive_of(inputs, rounded(gain * drawn)), hidden.decays, hidden.threshold, rounded(ring))[0]

    gain = reach_rate(fire, rate, spread)
    first, heard = clipped(gain * drawn), later(fire(gain))
    scale, n_heard = outputs.scale(n_steps), np.count_nonzero(heard)
    spread = math.sqrt(3 / max(1.0, n_heard / cells))
    drawn = rng.uniform(-1, 1, (hidden.n, outputs.n)) * scale
    share = heard.sum(axis=(0, 1)) / max(1, n_heard)
    fixed = spread * (drawn - sum(w * s for w, s in zip(drawn, share, strict=True)))
    target = (own["model.true_rate"] + (outputs.n - 1) * FALSE_RATE) / outputs.n
    out = outputs.decays, outputs.threshold
    gain = reach_rate(lambda x: run(drive_of(heard, rounded(x * scale + fixed)), *out)[0], target, spread)
    return first, ring, clipped(gain * scale + fixed)


# ==== 6. Training (dse/models/snn/train.py, dse/engine): surrogate gradients backward in time, then Adam ====
# Loss: sum over samples and outputs of (rate - target)^2. The reset is ignored, and rounding passes:
#     lv[t] = keep_v lv[t+1] + dL/ds[t] slope[t];   lu[t] = keep_u lu[t+1] + lv[t] = dL/dz[t]
#     dL/ds[t] of a hidden neuron = gain (sum over outputs of lu[t+1] w) + sum over its ring of lu[t+1] w
# Gradients are float32, so their order counts: products are added one by one (fma); weights' gradients are
# added chunk by chunk of samples, within one as `sum_in_fours` and `sum_one_by_one` say.


def flushed(x):
    """Return x with 0 for what is negligible, which would end as denormal numbers."""
    return np.where(np.abs(x) > F32(1e-30), x, F32(0))


def backward(layer, slope, by_spike):
    """Return dL/dz (sample, step, neuron) of a layer; `by_spike(t, lu)` is dL/ds of step t, given lu[t+1]."""
    keep_u, keep_v, by_input = layer.keep_u.astype(F32), layer.keep_v.astype(F32), np.empty_like(slope)
    lu = lv = np.zeros_like(slope[:, 0])
    for t in reversed(range(slope.shape[1])):
        lv = flushed(fma(keep_v, lv, by_spike(t, lu) * slope[:, t]))
        by_input[:, t] = lu = flushed(fma(keep_u, lu, lv))
    return by_input


def sum_in_fours(fired, by_input):
    """Return the sum of the rows of dL/dz (row, neuron) in which each input fires (row, input), float32.

    Rows are added in segments of 256: in each, fours as (a + b) + (c + d), then the rest one by one.
    """
    of_input, rows = np.nonzero(np.ascontiguousarray(fired.T))
    counts = np.bincount(of_input, minlength=fired.shape[1])
    order = np.argsort(-counts, kind="stable")  # inputs with most rows first: each step adds to the first few
    counts, starts = counts[order], (np.cumsum(counts) - counts)[order]
    sums = np.zeros((len(counts), by_input.shape[1]), F32)
    for segment in range(0, counts[0], 256):
        part, left, begin = np.zeros_like(sums), np.clip(counts - segment, 0, 256), starts + segment
        for e in range(0, left[0] - 3, 4):
            n = np.count_nonzero(left >= e + 4)
            a, b, c, d = by_input[rows[begin[:n] + e + np.arange(4)[:, None]]]
            part[:n] += (a + b) + (c + d)
        for e in range(3):
            some = np.flatnonzero(left % 4 > e)
            part[some] += by_input[rows[begin[some] + left[some] // 4 * 4 + e]]
        sums += part
    return sums[np.argsort(order)]


def sum_one_by_one(fired, by_input):
    """Return the same sums, row after row: of the outputs' weights and of the ring."""
    sums = np.zeros((fired.shape[1], by_input.shape[1]), F32)
    for i in np.flatnonzero(fired.any(axis=0)):
        sums[i] = np.add.accumulate(by_input[fired[:, i]], axis=0)[-1]
    return sums


class Adam:
    """A float32 matrix in training; a rate of 1 moves a weight by its neuron's initial root mean square."""

    def __init__(self, weights):
        self.weights, self.unit, self.number = weights, np.sqrt((weights**2).mean(axis=0)), 0
        self.first, self.second = np.zeros_like(weights), np.zeros_like(weights)

    def step(self, gradient, rate):
        """Move the weights against a gradient, within the range of 8 bits."""
        beta_1, beta_2, self.number = 0.9, 0.999, self.number + 1
        self.first = flushed(self.first + F32(1 - beta_1) * (gradient - self.first))
        self.second = flushed(self.second + F32(1 - beta_2) * (gradient * gradient - self.second))
        size = self.unit * F32(rate / (1 - beta_1**self.number))
        root = np.sqrt(self.second * F32(1 / (1 - beta_2**self.number))) + F32(1e-8)
        self.weights = clipped(self.weights - size * self.first / root)


def gradients_of(whole, hidden, outputs, inputs, gain, is_label, true_rate):
    """Return the gradients of a batch's loss by the hidden layer's weights, its ring, the outputs' weights.

    `whole` are the three matrices as they run, `gain` (sample, neuron) the factors of hidden spikes: 0 of
    those that dropout silences, one value of the others; `is_label` is (sample, output).
    """
    (first, ring, last), factor, n_steps = whole, gain.max(), inputs.shape[1]
    fired, potential, *_ = run(drive_of(inputs, first), hidden.decays, hidden.threshold, ring)
    sent = later(fired)
    heard = sent & (gain[:, None] != 0)
    drive = drive_of(heard, last, 1 / 32 * float(factor))
    answers, potential_out, *_ = run(drive, outputs.decays, outputs.threshold)
    # Nobody receives what is sent in the last step.
    error = answers[:, :-1].sum(axis=1) / n_steps - FALSE_RATE + is_label * (FALSE_RATE - true_rate)
    by_answer = (2 / n_steps * error).astype(F32)
    by_output = backward(outputs, outputs.slope(potential_out), lambda t, _: by_answer * (t + 1 < n_steps))

    def by_spike(t, lu):
        g = np.zeros_like(gain)
        for k, weights in enumerate(last.T / GRID if t + 1 < n_steps else ()):
            g = fma(by_output[:, t + 1, k, None], weights, g)
        g = g * gain
        for k, weights in enumerate(ring.T / GRID):
            g = fma(lu[:, k, None], weights, g)
        return g

    by_hidden = backward(hidden, hidden.slope(potential), by_spike)
    sums, size = [0.0, 0.0, 0.0], max(1, CHUNK_ROWS // n_steps)
    for k in range(0, len(inputs), size):
        rows = [x[k : k + size].reshape(-1, x.shape[2]) for x in (inputs, sent, heard, by_hidden, by_output)]
        sums[0] += sum_in_fours(rows[0], rows[3])
        sums[1] += sum_one_by_one(rows[1], rows[3])
        sums[2] += sum_one_by_one(rows[2], rows[4])
    return sums[0], sums[1], sums[2] * factor


def train(space, design, data):
    """Return the trained weights of a design, float32: of the hidden layer, its ring, the outputs.

    They are the mean of the last epochs. The order of samples is the same for all designs; hidden neurons
    drop out, sample by sample. The learning rate rises in the first epochs and then falls in steps.
    """
    seed, own, (hidden, outputs) = space["seed"], space | design, neurons_of(space, design, data)
    label, delays = data.labels[own["task.target"]][1], own["model.input_delays"]
    probe = generator(seed, {}, "probe", 0).permutation(data.train)[:64]
    inputs, rng = inputs_of(data.spikes[probe], delays), generator(seed, design, "initialisation", 0)
    matrices = [Adam(weights) for weights in initial_weights(inputs, own, hidden, outputs, rng)]
    orders, silenced = generator(seed, {}, "batches", 0), generator(seed, design, "dropout", 0)
    epochs, warmup, share = own["training.epochs"], own["training.warmup_epochs"], own["training.dropout"]
    n_averaged, means = min(epochs, own["training.average_epochs"]), [np.float64(0)] * 3
    for epoch in range(epochs):
        batches = np.split(orders.permutation(data.train), range(BATCH, data.train.size, BATCH))
        for number, samples in enumerate(batches):
            time = epoch + number / len(batches)
            rate = own["training.learning_rate"] * (min(1.0, (time + 1e-3) / warmup) if warmup else 1.0)
            rate = rate * LR_FACTOR ** (int(time) // own["training.lr_every"])
            kept = silenced.random((len(samples), hidden.n)) >= share
            is_label = (label[samples][:, None] == np.arange(outputs.n)).astype(np.float64)
            batch = inputs_of(data.spikes[samples], delays), (kept / F32(1 - share)).astype(F32), is_label
            setting = [rounded(x.weights) for x in matrices], hidden, outputs, *batch, own["model.true_rate"]
            for matrix, gradient in zip(matrices, gradients_of(*setting), strict=True):
                matrix.step(gradient, rate)
        if epoch >= epochs - n_averaged:
            means = [mean + x.weights / n_averaged for mean, x in zip(means, matrices, strict=True)]
    return [mean.astype(F32) for mean in means]


# ==== 7. The bundle: what a device needs, whole numbers alone, and its forward pass (dse/deploy) ====


def bundle_of(space, design, data, weights):
    """Return int8 weights (1/32), decays (1/4096), threshold (1/64), delays and classes, by name."""
    (hidden, outputs), own = neurons_of(space, design, data), space | design
    bundle = dict(zip(("first", "ring", "last"), (rounded(w).astype(np.int8) for w in weights), strict=True))
    bundle |= {"decays": hidden.decays, "output_decays": outputs.decays, "threshold": hidden.threshold}
    return bundle | {"delays": own["model.input_delays"], "classes": data.labels[own["task.target"]][0]}


def respond(bundle, spikes):
    """Return what a bundle does with touches, spikes (sample, step, channel): whole numbers throughout.

    That is (sample, step, class) output spikes as received, a step after they are sent; (sample, step, 5)
    work: spikes of inputs, hidden neurons and outputs, updates of the latter two; and the largest state.
    """
    inputs, threshold = inputs_of(spikes, bundle["delays"]), bundle["threshold"]
    of_inputs, ring = drive_of(inputs, bundle["first"]), bundle["ring"]
    fired, _, awake, peak = run(of_inputs, bundle["decays"], threshold, ring)
    drive = drive_of(later(fired), bundle["last"])
    answers, _, awake_out, peak_out = run(drive, bundle["output_decays"], threshold)
    work = np.stack([x.sum(axis=2) for x in (inputs, fired, answers, awake, awake_out)], axis=2)
    return later(answers), work, max(peak, peak_out)


# ==== 8. Measures (dse/measure): how well, how soon and with how much work a design answers ====


def decisions(output, phi, theta):
    """Return the answer and the step of the decision of each sample, under one setting (decision.py).

    The first step with more than phi output spikes so far, of which at least the share theta is for one
    class, decides for that class; without one, the last step does. The lowest class wins ties.
    """
    so_far = output.cumsum(axis=1)
    total = so_far.sum(axis=2)
    sure = (total > phi) & (so_far.max(axis=2) / np.maximum(total, 1) >= theta)
    step = np.where(sure.any(axis=1), sure.argmax(axis=1), output.shape[1] - 1)
    return so_far[np.arange(len(output)), step].argmax(axis=1), step


def measure(space, design, data, bundle):
    """Return the design points of a trained design as columns, a row each, in the order of dse's table.

    The read-out of the whole input comes first, then all (phi, theta), then read-outs of shorter inputs.
    """
    own, step_ms, rows = space | design, data.step_ms, []
    truth = data.labels[own["task.target"]][1][data.validation]
    output, work, peak = respond(bundle, data.spikes[data.validation])
    (n, n_steps, _), done = output.shape, work.cumsum(axis=1)

    def add(phi, theta, read_out_ms, answer, step):
        spent, latency_ms = done[np.arange(n), step].sum(axis=0) / n, (step + 1).sum() / n * step_ms
        rows.append([phi, theta, read_out_ms, (answer == truth).sum() / n, latency_ms, *spent])

    axes = [(*own[name]["range"], own[name]["step"]) for name in ("decision.phi", "decision.theta")]
    settings = [np.arange(low, high + step / 2, step).round(10) for low, high, step in axes]
    lengths = np.unique(np.rint(np.linspace(n_steps / READ_OUTS, n_steps, READ_OUTS)).astype(int))
    for length in [n_steps, *lengths[:-1]]:
        is_whole, answer = length == n_steps, output[:, :length].sum(axis=1).argmax(axis=1)
        add(np.nan, np.nan, np.nan if is_whole else length * step_ms, answer, np.full(n, length - 1))
        for phi, theta in itertools.product(*settings) if is_whole else ():
            add(phi, theta, np.nan, *decisions(output, phi, theta))
    table, sizes = np.array(rows).T, (len(bundle["first"]), *bundle["last"].shape)
    names = "phi", "theta", "read_out_ms", "accuracy", "decision_latency_ms"
    columns = dict(zip(names, table, strict=False)) | {"spikes_per_inference": table[5:8].sum(axis=0)}
    columns["n_weights"] = np.full(len(rows), sum(bundle[name].size for name in ("first", "ring", "last")))
    return columns | cost(own["hardware"], sizes, np.stack([table[4] / step_ms, *table[5:]]), peak)


# ==== 9. Cost on a chip, a mesh of cores such as Loihi (dse/measure/hardware: kinds/mesh, cost) ====
#     energy = access N T + update U + spike S + event sum_l s_l f_l + message M + static power x time
#     step   = barrier + max over cores of (access n + update u + spike s + message_out m) and of
#              (messages received x (message_in + event n))


def cost(hardware, sizes, counts, peak):
    """Return the energy of each design point, and whether the chip holds the network.

    Sizes are those of inputs (copies included), hidden and output neurons; counts (6, point) are the steps of
    an inference, spikes of the three layers, updates of two; the peak is that of a state, in 1/4096.
    """
    profile, (n_in, n, n_out) = read_yaml("dse/measure/hardware/profiles", f"{hardware[0]}.yaml"), sizes
    if profile["kind"] != "mesh" or len(hardware) > 1:
        refuse(f"hardware must be one mesh, got {hardware}")
    chip = SimpleNamespace(**{key: x["value"] for key, x in profile.items() if isinstance(x, dict)})
    cores, bits = [], chip.synapse_word_bits
    for n_neurons, axons in ((n, n_in + n), (n_out, n)):
        # An input axon lists its targets in a core in blocks, each rounded up to words; 8 bits a weight.
        words = chip.synapse_memory_bits // (axons * bits)
        blocks, rest = divmod(words, -(-(chip.synapse_block * 8 + chip.synapse_header_bits) // bits))
        held = blocks * chip.synapse_block + max(rest * bits - chip.synapse_header_bits, 0) // 8
        cores.append(-(-n_neurons // min(max(held, 1), chip.neurons_per_core)))
    if sum(cores) > chip.cores_per_tile or chip.congestion_factor != 1:
        refuse("only networks within a tile, without congestion, are known")
    sent_in, sent = cores[0], cores[0] + cores[1]  # cores that a spike goes to; outputs send to none
    per_input = chip.synaptic_event_pj * n + chip.message_pj * sent_in
    per_hidden = chip.spike_pj + chip.synaptic_event_pj * (n_out + n) + chip.message_pj * sent
    updates = [chip.neuron_update_pj] * 2
    per_count = [chip.neuron_access_pj * (n + n_out), per_input, per_hidden, chip.spike_pj, *updates]
    # What may be the slowest: who sends the inputs, and of each layer a core that sends or receives.
    here, here_out, barrier_ns = -(-n // cores[0]), -(-n_out // cores[1]), chip.barrier_1_us * 1e3
    share, share_out = here / n, here_out / n_out
    receive, receive_out = (chip.synaptic_event_ns * k + chip.message_in_ns for k in (here, here_out))
    send = chip.spike_ns * share + chip.message_out_ns * (sent * share)
    access, update = chip.neuron_access_ns, chip.neuron_update_ns
    times_ns = [
        [barrier_ns, chip.message_out_ns * (sent_in / -(-n_in // chip.neurons_per_core)), 0, 0, 0, 0],
        [access * here + barrier_ns, 0, send, 0, update * share, 0],
        [barrier_ns, receive, receive, 0, 0, 0],
        [access * here_out + barrier_ns, 0, 0, chip.spike_ns * share_out, 0, update * share_out],
        [barrier_ns, 0, receive_out, 0, 0, 0],
    ]

    def in_turn(factors):  # a matrix product would add in the order of the processor
        return sum(factor * count for factor, count in zip(factors, counts, strict=True))

    time_us = np.max([in_turn(np.array(ns) * 1e-3) for ns in times_ns], axis=0)
    energy_uj = in_turn(np.array(per_count) * 1e-6) + chip.static_mw * time_us * 1e-3
    fits = n_in + n <= chip.input_axons_per_core and peak < 2 ** (chip.state_bits - 1)
    return {"energy_uj": energy_uj, "fits": np.full(len(time_us), fits)}


# ==== 10. The Pareto front (dse/skyline): of each task, the points that no other point beats ====


def front(space, tables):
    """Return the rows (design, point) of the front, by task, then objectives, best first; equal ones stay."""
    goals = [(x.split(":")[0], -1 if x.endswith(":max") else 1) for x in space["objectives"]]
    designs, front = designs_of(space), []
    for task in dict.fromkeys(designs[number]["task.target"] for number in tables):
        of_task = {k: x for k, x in tables.items() if designs[k]["task.target"] == task}
        rows = [(k, p) for k, x in of_task.items() for p in np.flatnonzero(x["fits"]).tolist()]
        costs = np.array([[tables[k][name][p] * sign for name, sign in goals] for k, p in rows])
        stays = [not ((costs <= one).all(axis=1) & (costs < one).any(axis=1)).any() for one in costs]
        kept = np.flatnonzero(stays)
        front += [rows[k] for k in kept[np.lexsort(costs[kept].T[::-1])]]
    return front


def main(path, *arguments):
    """Run designs of a space, given by number; print the measures of each, and their front."""
    space, tables = read_space(path, [x for x in arguments if "=" in x]), {}
    designs, numbers = designs_of(space), [int(x) for x in arguments if x.isdigit()]
    if not numbers or max(numbers) >= len(designs):
        refuse(f"name designs by number, 0 to {len(designs) - 1}, got {numbers or 'none'}")
    data = prepare(space)
    for number in numbers:
        bundle = bundle_of(space, designs[number], data, train(space, designs[number], data))
        tables[number] = measure(space, designs[number], data, bundle)
        for file in [x for x in arguments if x.endswith(".npz")]:
            np.savez(file, **bundle)
    for title, rows in (("full", [(number, 0) for number in tables]), ("front", front(space, tables))):
        print(f"{title:>6}", *next(iter(tables.values())))
        for number, point in rows:
            cells = (f"{float(x[point]):>{len(name)}.8g}" for name, x in tables[number].items())
            print(f"{number:6d}", *cells)


if __name__ == "__main__":
    main(*(sys.argv[1:] or refuse("name a search space and numbers of designs")))
