#pragma once

#include "computing/evaluation.hpp"
#include "report/records.hpp"

#include "lumo/optimize/problem.hpp"
#include "lumo/study/paired_differences.hpp"

#include <functional>
#include <string>
#include <vector>

namespace lumo::program {

/// What a study keeps of one design.
struct StudyRow {
  std::vector<double> theta_mm;
  Json record;
};

Json json(const PairedSummary& s);

/// Evaluates the designs that the store lacks ("": one in memory), with a line of progress for each, of which `outcome`
/// gives the end. All rows are read from the store, so that a study that was interrupted gives the same.
/// `problem_text`: what the store is for. Throws StoreError, CampaignError.
std::vector<StudyRow> study_rows(const std::string& store, const std::string& problem_text, const Problem& problem,
    const Evaluator& evaluate, const std::function<std::string(const StudyRow&)>& outcome, Progress& progress);

}  // namespace lumo::program
