#pragma once

#include "commands/studies.hpp"

#include "lumo/campaign/finger_campaign.hpp"
#include "lumo/study/assumptions.hpp"

#include <string>
#include <vector>

namespace lumo::program {

/// How far results move with each reading of what the paper leaves open.
struct StudyReadings : StudyCommand {
  StudyReadings() { designs = 30; }

  void declare(CLI::App& app);
  /// Throws StoreError.
  Result run(Output& files, Progress& progress) const;

 private:
  std::vector<AssumptionVariant> only_;  ///< asked for; empty: all
  std::vector<Scenario<Sphere>> pressed() const {
    return whole_ensemble() ? asked().ensemble.scenarios() : assumption_contacts();
  }
  std::string contacts_name() const { return whole_ensemble() ? name(asked().ensemble) : "few"; }
  /// Those asked for, or all that change what is usual.
  std::vector<AssumptionVariant> variants() const;
  Problem problem() const;
  std::string problem_text(const Problem& p) const;
  /// In the words of captions.
  std::string about() const;
};

}  // namespace lumo::program
