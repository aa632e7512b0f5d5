"""The problems on which lumo and BoTorch are compared: two lattices of our own, and five from the literature.

A problem is a space file's contents without starts, an objective, and the hypervolume of its true front.
"""

import itertools
import math

import numpy as np


class Problem:
    def __init__(self, name, variables, constraints, objectives, evaluate, best):
        self.name, self.variables, self.constraints, self.objectives = name, variables, constraints, objectives
        self.evaluate = evaluate  # n × d → n × m in the objectives' own sense; NaN where the evaluation fails
        self._best = best
        self.lower = np.array([v["lower"] for v in variables], float)
        self.upper = np.array([v["upper"] for v in variables], float)
        self.step = np.array([v.get("step", 0.0) for v in variables])
        self.sign = np.array([1.0 if o["goal"] == "maximize" else -1.0 for o in objectives])
        self.reference = np.array([o["reference"] for o in objectives]) * self.sign

    def feasible(self, x):
        keep = np.ones(len(x), bool)
        for c in self.constraints:
            total = sum(k * x[:, [v["name"] for v in self.variables].index(n)] for n, k in c["terms"].items())
            keep &= (total <= c.get("upper", math.inf)) & (total >= c.get("lower", -math.inf))
        return keep

    def snap(self, u):
        """Points of the unit cube → designs; every node of a lattice gets an equal share."""
        x = self.lower + u * (self.upper - self.lower)
        if self.step.any():
            nodes = np.round((self.upper - self.lower) / np.where(self.step > 0, self.step, 1.0)) + 1
            on = self.lower + np.minimum(np.floor(u * nodes), nodes - 1) * self.step
            x = np.where(self.step > 0, on, x)
        return x

    def fresh(self, rng, count, taken=()):
        """`count` different feasible designs, none of them in `taken`."""
        out, seen = [], {tuple(t) for t in taken}
        while len(out) < count:
            x = self.snap(rng.random((4 * count, len(self.lower))))
            for row in x[self.feasible(x)]:
                if tuple(row) not in seen and len(out) < count:
                    seen.add(tuple(row))
                    out.append(row)
        return np.array(out)

    def space(self, **more):
        return {"variables": self.variables, "constraints": self.constraints, "objectives": self.objectives, **more}

    def best(self):
        """Hypervolume of the true front."""
        return self._best(self)


def hypervolume(y, reference):
    """Two objectives, both maximised; rows that are not finite are left out."""
    y = y[np.isfinite(y).all(1)]
    y = y[(y > reference).all(1)]
    total, level = 0.0, reference[1]
    for a, b in y[np.argsort(-y[:, 0], kind="stable")]:
        if b > level:
            total += (a - reference[0]) * (b - level)
            level = b
    return total


def enumerate_lattice(problem):
    """Hypervolume of the best that the whole lattice holds."""
    axes = [np.arange(v["lower"], v["upper"] + 1e-9, v["step"]) for v in problem.variables]
    front = np.empty((0, 2))
    for head in itertools.product(axes[0], axes[1]):
        tail = np.stack(np.meshgrid(*axes[2:], indexing="ij"), -1).reshape(-1, len(axes) - 2)
        x = np.hstack([np.tile(head, (len(tail), 1)), tail])
        x = x[problem.feasible(x)]
        if not len(x):
            continue
        y = np.vstack([front, problem.evaluate(x) * problem.sign])
        y = y[np.lexsort((-y[:, 1], -y[:, 0]))]
        front = y[y[:, 1] > np.concatenate([[-np.inf], np.maximum.accumulate(y[:, 1])[:-1]])]
    return hypervolume(front, problem.reference)


def worst_case():
    """Five lengths on a 0.5 lattice with linear constraints; each objective is the least of fourteen scenarios' smooth
    scores."""
    rng = np.random.RandomState(7)
    names = ["a", "b", "c", "d", "e"]
    bounds = [(2, 29), (1, 20), (4, 15), (2, 15), (0, 7.5)]
    low, high = np.array(bounds, float).T
    centre = np.array([[0.15, 0.45, 0.35, 0.2, 0.6], [0.35, 0.2, 0.6, 0.35, 0.2]])
    p = centre[:, None, :] + 0.12 * rng.standard_normal((2, 14, 5))
    w = rng.uniform(0.8, 4.0, (2, 14, 5))
    b = rng.standard_normal((2, 14, 5))
    shift = rng.uniform(0, 2 * np.pi, (2, 14))

    def evaluate(x):
        u = (x - low) / (high - low)
        out = np.empty((len(x), 2))
        for j in range(2):
            scores = [
                np.exp(-(w[j, s] * (u - p[j, s]) ** 2).sum(1)) + 0.08 * np.cos(4.0 * (u @ b[j, s]) + shift[j, s])
                for s in range(14)
            ]
            out[:, j] = np.min(scores, axis=0)
        return out

    variables = [{"name": n, "lower": float(l), "upper": float(h), "step": 0.5} for n, (l, h) in zip(names, bounds)]
    constraints = [
        {"terms": {"a": 1, "b": 1}, "upper": 20},
        {"terms": {"c": 1, "e": 2}, "upper": 19.5},
        {"terms": {"a": 1, "b": 1, "d": -1}, "lower": 5},
    ]
    objectives = [
        {"name": "f1", "goal": "maximize", "reference": 0.0},
        {"name": "f2", "goal": "maximize", "reference": 0.0},
    ]
    return Problem("worst case", variables, constraints, objectives, evaluate, enumerate_lattice)


def smooth_lattice():
    """Five variables on a 0.5 lattice under two-sided linear constraints; a cost to keep low against a gain with a
    ridge and saturation."""

    def evaluate(x):
        u = x / 10.0
        cost = (
            2.0 * u[:, 0]
            + u[:, 1] ** 2
            + 1.5 * u[:, 2] * u[:, 3]
            + 0.8 * (u[:, 4] - 0.3) ** 2
            + 0.25 * np.sin(6.0 * u[:, 1] + 3.0 * u[:, 4])
        )
        ridge = np.exp(-8.0 * (u[:, 1] - u[:, 2] ** 2 - 0.1) ** 2)
        gain = (
            (1.0 - np.exp(-2.5 * u[:, 0])) * ridge
            + 0.7 * u[:, 3] / (0.3 + u[:, 3])
            + 0.4 * np.sin(np.pi * u[:, 4]) * (1.0 - 0.5 * u[:, 2])
        )
        return np.stack([cost, gain], 1)

    variables = [{"name": f"x{i}", "lower": 0.0, "upper": 10.0, "step": 0.5} for i in range(5)]
    constraints = [
        {"terms": {f"x{i}": 1 for i in range(5)}, "lower": 10, "upper": 32},
        {"terms": {"x0": 1, "x3": -1}, "upper": 4, "lower": -8},
    ]
    objectives = [
        {"name": "cost", "goal": "minimize", "reference": 3.0},
        {"name": "gain", "goal": "maximize", "reference": 0.3},
    ]
    return Problem("smooth lattice", variables, constraints, objectives, evaluate, enumerate_lattice)


def bnh():
    """Binh & Korn 1997. Its two constraints are not linear: designs that break them fail."""

    def evaluate(x):
        y = np.stack([4 * x[:, 0] ** 2 + 4 * x[:, 1] ** 2, (x[:, 0] - 5) ** 2 + (x[:, 1] - 5) ** 2], 1)
        bad = ((x[:, 0] - 5) ** 2 + x[:, 1] ** 2 > 25) | ((x[:, 0] - 8) ** 2 + (x[:, 1] + 3) ** 2 < 7.7)
        y[bad] = np.nan
        return y

    def best(problem):
        t = np.linspace(0, 3, 200001)  # x1 = x2 to (3, 3), then x2 = 3
        x = np.vstack([np.stack([t, t], 1), np.stack([3 + t * 2 / 3, np.full_like(t, 3)], 1)])
        return hypervolume(evaluate(x) * problem.sign, problem.reference)

    variables = [{"name": "x1", "lower": 0.0, "upper": 5.0}, {"name": "x2", "lower": 0.0, "upper": 3.0}]
    objectives = [
        {"name": "f1", "goal": "minimize", "reference": 140.0},
        {"name": "f2", "goal": "minimize", "reference": 50.0},
    ]
    return Problem("BNH", variables, [], objectives, evaluate, best)


def zdt(number, d=6):
    """Zitzler, Deb & Thiele 2000."""

    def evaluate(x):
        f, g = x[:, 0], 1 + 9 * x[:, 1:].mean(1)
        if number == 1:
            h = 1 - np.sqrt(f / g)
        elif number == 2:
            h = 1 - (f / g) ** 2
        else:
            h = 1 - np.sqrt(f / g) - f / g * np.sin(10 * np.pi * f)
        return np.stack([f, g * h], 1)

    def best(problem):
        x = np.zeros((200001, d))
        x[:, 0] = np.linspace(0, 1, len(x))
        return hypervolume(evaluate(x) * problem.sign, problem.reference)

    variables = [{"name": f"x{i}", "lower": 0.0, "upper": 1.0} for i in range(d)]
    objectives = [{"name": n, "goal": "minimize", "reference": 11.0} for n in ("f1", "f2")]
    return Problem(f"ZDT{number}", variables, [], objectives, evaluate, best)


def dtlz2(d=6):
    """Deb, Thiele, Laumanns & Zitzler 2002, two objectives."""

    def evaluate(x):
        g = 1 + ((x[:, 1:] - 0.5) ** 2).sum(1)
        return np.stack([g * np.cos(np.pi / 2 * x[:, 0]), g * np.sin(np.pi / 2 * x[:, 0])], 1)

    variables = [{"name": f"x{i}", "lower": 0.0, "upper": 1.0} for i in range(d)]
    objectives = [{"name": n, "goal": "minimize", "reference": 1.1} for n in ("f1", "f2")]
    return Problem("DTLZ2", variables, [], objectives, evaluate, lambda problem: 1.1**2 - math.pi / 4)


ALL = {p.name: p for p in (worst_case(), smooth_lattice(), bnh(), zdt(1), zdt(2), zdt(3), dtlz2())}
