#include "program/lab.hpp"

#include "lumo/lab/pad_file.hpp"
#include "lumo/lab/virtual_rig.hpp"
#include "lumo/morphology/finger.hpp"
#include "lumo/support/json.hpp"
#include "lumo/support/opencv.hpp"
#include "program/commands.hpp"
#include "program/json.hpp"
#include "program/text.hpp"

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>

namespace lumo::program {

namespace fs = std::filesystem;

namespace {

/// The file that a key's responses are kept in; its name tells pads and settings apart.
std::string cache_file(const Options& o, const std::string& key) {
  std::error_code error;
  const fs::path out = fs::absolute(*o.out, error).lexically_normal();
  const fs::path folder = o.cache ? fs::path(*o.cache) : (out.has_filename() ? out : out.parent_path()).parent_path();
  fs::create_directories(folder, error);
  char name[48];
  std::snprintf(name, sizeof name, "lumo-pad-%016llx.txt", static_cast<unsigned long long>(lumo::detail::checksum(key)));
  return (folder / name).string();
}

PadResponses responses(const Options& o, Progress& progress) {
  const std::string key = pad_responses_key(o), file = cache_file(o, key);
  try {
    if (auto kept = read_pad_responses(file, key)) return std::move(*kept);
  } catch (const InputError& e) {
    progress.note(std::string(e.what()) + "; computed anew");
  }
  PadResponses r = make_pad_responses(o, progress);
  write_pad_responses(file, r, key);
  progress.finish();
  progress.note("kept in " + file);
  return r;
}

LabPlan plan_of(Command c) {
  switch (c) {
    case Command::lab_recontact: return recontact_plan();
    case Command::lab_cycle: return cycle_plan();
    case Command::lab_imaging: return imaging_plan();
    default: return force_plan();
  }
}

/// A folder that takes its name only when all is in it.
class NewFolder {
 public:
  explicit NewFolder(const std::string& path) : path_(fs::path(path).lexically_normal()) {
    if (!path_.has_filename()) path_ = path_.parent_path();
    std::error_code error;
    if (fs::exists(path_, error) && !(fs::is_directory(path_, error) && fs::is_empty(path_, error))) throw InputError("cannot write to '" + path + "': it is there and not empty");
    part_ = path_.string() + ".part-" + std::to_string(getpid());
    fs::create_directories(part_ / "frames", error);
    if (error) throw InputError("cannot write to '" + path + "': " + error.message());
  }
  ~NewFolder() {
    std::error_code error;
    if (!part_.empty()) fs::remove_all(part_, error);
  }
  NewFolder(const NewFolder&) = delete;
  NewFolder& operator=(const NewFolder&) = delete;

  const fs::path& path() const { return part_; }
  void keep() {
    std::error_code error;
    fs::remove(path_, error);
    fs::rename(part_, path_, error);
    if (error) throw InputError("cannot write to '" + path_.string() + "': " + error.message());
    part_.clear();
  }

 private:
  fs::path path_, part_;
};

}  // namespace

std::string lab(const Options& o, Progress& progress) {
  NewFolder folder(*o.out);
  const PadLight light(responses(o, progress));
  const VirtualRig rig(light, plan_of(o.command), std::uint64_t(o.seed), o.noise, {}, side_geometry(finger(FingerDesign::from(o.theta_mm), silicone(o.material))));
  progress.stage("pictures", int(rig.frames().size()));
  for (std::size_t k = 0; k < rig.frames().size(); ++k) {
    write_image((folder.path() / "frames" / rig.frames()[k].file).string(), rig.image(k).view());
    progress.step();
  }
  write_log_folder({folder.path().string(), rig.session(), rig.frames(), rig.joints(), rig.wrenches(), rig.markers()});
  std::ofstream truth(folder.path() / "truth.csv", std::ios::binary);
  truth << truth_text(rig.truth());
  truth.close();
  if (!truth) throw InputError("cannot write to '" + *o.out + "/truth.csv'");
  folder.keep();
  progress.finish();

  int touched = 0;
  for (const TruthSample& s : rig.truth()) touched += s.contact >= 0;
  if (o.json)
    return Json{{"out", *o.out}, {"frames", rig.frames().size()}, {"contact_frames", touched}, {"contacts", rig.plan().contacts.size()}, {"joint_samples", rig.joints().size()},
                {"seed", o.seed}, {"noise", o.noise}}.dump(2) + "\n";
  return lumo::detail::text(*o.out, ": ", rig.plan().title, "; ", rig.plan().contacts.size(), " contacts, ", rig.frames().size(), " pictures, ", touched, " of them in contact, ", rig.joints().size(),
                            " joint samples, seed ", o.seed, ", noise ", o.noise, "\n");
}

}  // namespace lumo::program
