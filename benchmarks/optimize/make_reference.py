#!/usr/bin/env python3
"""Writes tests/optimize/reference/botorch.json: what BoTorch computes on small problems, for the tests to compare with.

usage: benchmarks/optimize/make_reference.py [FILE]     (needs botorch: run it with "$(benchmarks/environment
       optimize)")
"""

import json
import math
import pathlib
import sys
import warnings

import botorch
import gpytorch
import numpy as np
import torch
from botorch.acquisition.multi_objective.logei import (
    qLogExpectedHypervolumeImprovement,
    qLogNoisyExpectedHypervolumeImprovement,
)
from botorch.fit import fit_gpytorch_mll
from botorch.models import SingleTaskGP
from botorch.models.utils.gpytorch_modules import get_covar_module_with_dim_scaled_prior
from botorch.sampling.normal import SobolQMCNormalSampler
from botorch.utils.multi_objective.box_decompositions.non_dominated import FastNondominatedPartitioning
from botorch.utils.multi_objective.hypervolume import Hypervolume
from gpytorch.mlls import ExactMarginalLogLikelihood

warnings.filterwarnings("ignore")
torch.set_default_dtype(torch.double)
torch.set_num_threads(1)


def plain(tensor):
    return np.asarray(tensor.detach() if torch.is_tensor(tensor) else tensor).tolist()


def smooth(x):
    return torch.sin(4 * x[:, 0]) + x[:, 1] ** 2 - x[:, 0] * x[:, -1]


def worst_case(x):
    g = torch.Generator().manual_seed(5)
    centre, weight = torch.rand(6, x.shape[1], generator=g), 1 + 4 * torch.rand(6, x.shape[1], generator=g)
    return torch.stack([torch.exp(-((x - c) ** 2 * w).sum(1)) for c, w in zip(centre, weight)]).amin(0)


def model_of(x, y, kernel):
    covariance = get_covar_module_with_dim_scaled_prior(ard_num_dims=x.shape[1], use_rbf_kernel=kernel == "rbf")
    return SingleTaskGP(x, y, covar_module=covariance)


def set_hyperparameters(model, lengths, noise, mean):
    model.covar_module.lengthscale = torch.as_tensor(lengths)
    model.likelihood.noise = torch.as_tensor(noise)
    model.mean_module.initialize(constant=torch.as_tensor(mean))


def best_mean(model):
    """The constant mean that maximises the likelihood at the model's other hyper-parameters."""
    k = model.covar_module(model.train_inputs[0]).to_dense() + model.likelihood.noise * torch.eye(
        len(model.train_targets)
    )
    one = torch.ones_like(model.train_targets)
    return float((one @ torch.linalg.solve(k, model.train_targets)) / (one @ torch.linalg.solve(k, one)))


def regression(name, function, n, d, seed, kernel, lengths, noise, scale=1.0):
    g = torch.Generator().manual_seed(seed)
    x, test = torch.rand(n, d, generator=g), torch.rand(6, d, generator=g)
    y = scale * function(x)[:, None]
    model = model_of(x, y, kernel)
    mll = ExactMarginalLogLikelihood(model.likelihood, model)
    set_hyperparameters(model, lengths, noise, 0.0)
    set_hyperparameters(model, lengths, noise, best_mean(model))
    mll.train()
    log_likelihood = model.likelihood(model(*model.train_inputs)).log_prob(model.train_targets)
    log_likelihood.backward()
    raw = model.covar_module.raw_lengthscale.grad.flatten(), model.likelihood.noise_covar.raw_noise.grad.flatten()
    # No transform stands between raw and true values but the bound, so raw gradients are gradients; ours are in
    # logarithms.
    gradient = torch.cat([raw[0] * model.covar_module.lengthscale.flatten(), raw[1] * model.likelihood.noise])
    objective = float(mll(model(*model.train_inputs), model.train_targets))
    mll.eval()
    posterior = model.posterior(test)
    joint = posterior.distribution.covariance_matrix
    case = {
        "name": name,
        "kernel": kernel,
        "x": plain(x),
        "y": plain(y.flatten()),
        "length_scale": lengths,
        "noise": noise,
        "mean": float(model.mean_module.constant),
        "log_likelihood": float(log_likelihood),
        "gradient": plain(gradient),
        "objective": objective,
        "test": plain(test),
        "posterior_mean": plain(posterior.mean.flatten()),
        "posterior_covariance": plain(joint),
    }
    model = model_of(x, y, kernel)
    mll = ExactMarginalLogLikelihood(model.likelihood, model)
    fit_gpytorch_mll(mll)
    mll.train()
    case["fitted"] = {
        "length_scale": plain(model.covar_module.lengthscale.flatten()),
        "noise": float(model.likelihood.noise),
        "mean": float(model.mean_module.constant),
        "objective": float(mll(model(*model.train_inputs), model.train_targets)),
    }
    mll.eval()
    case["fitted"]["posterior_mean"] = plain(model.posterior(test).mean.flatten())
    return case


def hypervolumes():
    out = []
    for m, n, seed in [(2, 1, 0), (2, 12, 1), (2, 40, 2), (3, 15, 3), (4, 10, 4)]:
        g = torch.Generator().manual_seed(seed)
        y = torch.rand(n, m, generator=g)
        reference = torch.full((m,), 0.2)
        above = y[(y > reference).all(1)]
        keep = botorch.utils.multi_objective.pareto.is_non_dominated(above)
        out.append(
            {
                "y": plain(y),
                "reference": plain(reference),
                "hypervolume": float(Hypervolume(reference).compute(above[keep])),
            }
        )
    return out


def acquisition(name, noisy, pending, seed):
    g = torch.Generator().manual_seed(seed)
    x = torch.rand(12, 2, generator=g)
    y = torch.stack([1 - (x[:, 0] - 0.3) ** 2 - x[:, 1] ** 2, 1 - (x[:, 0] - 0.8) ** 2 - (x[:, 1] - 0.4) ** 2], 1)
    model = SingleTaskGP(x, y)
    lengths = torch.tensor([[[0.2, 0.25]], [[0.3, 0.2]]])
    noise, mean = torch.tensor([[0.05], [0.1]]), torch.tensor([0.1, -0.2])
    model.covar_module.lengthscale = lengths
    model.likelihood.noise = noise
    model.mean_module.initialize(constant=mean)
    model.eval()
    candidates = torch.rand(20, 2, generator=g)
    waiting = torch.rand(2, 2, generator=g) if pending else None
    reference = torch.tensor([0.2, 0.3])
    draws = 16
    sampler = SobolQMCNormalSampler(torch.Size([draws]), seed=seed)
    if noisy:
        acq = qLogNoisyExpectedHypervolumeImprovement(
            model, reference, x, sampler=sampler, X_pending=waiting, prune_baseline=False
        )
    else:
        partition = FastNondominatedPartitioning(reference, y)
        acq = qLogExpectedHypervolumeImprovement(model, reference, partition, sampler=sampler)
    with torch.no_grad():
        values = acq(candidates.unsqueeze(1))
    normals = acq.sampler.base_samples.reshape(draws, -1, 2)  # draws × (base points + candidate) × outputs
    case = {
        "name": name,
        "noisy": noisy,
        "x": plain(x),
        "y": plain(y),
        "reference": plain(reference),
        "pending": plain(waiting) if pending else [],
        "length_scale": plain(lengths[:, 0]),
        "noise": plain(noise.flatten()),
        "mean": plain(mean),
        "candidates": plain(candidates),
        "normals": plain(normals),
        "tau_relu": acq.tau_relu,
        "tau_max": acq.tau_max,
        "values": plain(values),
    }
    if noisy:
        base = acq.base_sampler.base_samples.reshape(draws, -1, 2)
        case["base_normals"] = plain(base)
    return case


reference = {
    "versions": {"botorch": botorch.__version__, "gpytorch": gpytorch.__version__, "torch": torch.__version__},
    "regression": [
        regression("smooth", smooth, 20, 3, 0, "rbf", [0.4, 0.7, 1.3], 1e-3),
        regression("worst case", worst_case, 13, 5, 1, "rbf", [0.5, 0.6, 0.7, 0.8, 0.9], 1e-2),
        regression("Matern", smooth, 25, 2, 2, "matern", [0.5, 0.8], 1e-2),
        regression("large", smooth, 15, 2, 3, "rbf", [0.5, 0.8], 1e-2, 1e12),
        regression("small", worst_case, 30, 4, 4, "rbf", [0.5, 0.6, 0.8, 0.9], 1e-3, 1e-6),
    ],
    "hypervolume": hypervolumes(),
    "acquisition": [
        acquisition("qLogEHVI", False, False, 10),
        acquisition("qLogNEHVI", True, False, 11),
        acquisition("qLogNEHVI pending", True, True, 12),
    ],
}
target = (
    pathlib.Path(sys.argv[1])
    if len(sys.argv) > 1
    else pathlib.Path(__file__).resolve().parents[2] / "tests/optimize/reference/botorch.json"
)
with open(target, "w") as file:
    file.write("{\n")
    for i, (key, value) in enumerate(reference.items()):
        rows = value if isinstance(value, list) else None
        body = "[\n  " + ",\n  ".join(json.dumps(r) for r in rows) + "\n]" if rows else json.dumps(value)
        file.write(f"{json.dumps(key)}: {body}{',' if i + 1 < len(reference) else ''}\n")
    file.write("}\n")
assert all(math.isfinite(c["objective"]) for c in reference["regression"])
