#pragma once

#include "lumo/campaign/ensemble.hpp"
#include "program/options.hpp"

namespace lumo::program {

/// The contacts that an ensemble's name stands for.
inline lumo::Ensemble contacts(Ensemble e) { return e == Ensemble::flat ? flat_ensemble() : curved_ensemble(); }

}  // namespace lumo::program
