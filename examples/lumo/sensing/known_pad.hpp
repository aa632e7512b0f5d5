#pragma once

#include "console/progress.hpp"
#include "report/json.hpp"
#include "sensing/log.hpp"

#include "lumo/sense/force/finger_model.hpp"
#include "lumo/sense/localize/sensibility.hpp"

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace lumo::program {

using namespace sense;

/// A pad whose responses a localiser is given.
struct KnownPad {
  std::string path;  ///< of the file or log that they are from
  TemplateSource source = TemplateSource::computed;
  ResponseTemplates templates;
  std::string material;          ///< may be empty
  std::vector<double> theta_mm;  ///< may be empty

  TemplateLocalizer localizer(const FingerOptics& finger, const Session& session) const;
};

/// Computed responses that `lumo lab … --cache DIR` keeps. Throws InputError.
KnownPad computed_pad(const std::string& file);
/// The holds of a log at known places (`lumo lab recontact`, or a real one like it). Throws InputError.
KnownPad recorded_pad(const std::string& log, Progress& progress, const McapTopics& topics);

/// What can be said of a pad before a log is read: at 2 and 5 N. None for recorded responses, whose size the session's
/// camera decides.
std::optional<std::array<Sensibility, 2>> sensibility_of(const KnownPad& pad);
std::string sensibility_text(const KnownPad& pad);
Json sensibility_json(const KnownPad& pad);

/// Says so where the log states another design or silicone than the pad's.
void tell_other_pad(const KnownPad& pad, const Session& session, const std::string& log, Progress& progress);

}  // namespace lumo::program
