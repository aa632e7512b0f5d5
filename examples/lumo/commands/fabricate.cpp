#include "commands/commands.hpp"

#include "console/text.hpp"
#include "lumo/fabrication/casting_drawings.hpp"
#include "lumo/fabrication/casting_kit.hpp"
#include "lumo/fabrication/drawing.hpp"
#include "lumo/fabrication/stl.hpp"
#include "lumo/morphology/silicone.hpp"
#include "lumo/support/zip.hpp"
#include "report/json.hpp"
#include "report/present.hpp"

#include <algorithm>
#include <optional>
#include <span>
#include <sstream>
#include <vector>

namespace lumo::program {

namespace {

constexpr double print_density_kg_per_m3 = 1240.0;  // PLA: NatureWorks, Ingeo 4043D data sheet (ASTM D792)
constexpr double reserve = 1.25;                    // what stays in cups, on sticks and in syringes

/// What `write` writes, for a file that appears with the others.
template <class Write> void add(Output& files, const std::string& name, const Write& write) {
  std::ostringstream out;
  write(out);
  files.add(name, out.str());
}

void add(Output& files, const std::string& name, const Drawing& drawing) {
  add(files, name + ".dxf", [&](std::ostream& out) { write_dxf(out, drawing); });
  add(files, name + ".svg", [&](std::ostream& out) { write_svg(out, drawing); });
}

void add_files(const HalfSection& s, const CastingOptions& o, const std::vector<CastingPart>& kit, Output& files) {
  std::vector<PrintItem> carrier, mould;
  for (const CastingPart& part : kit) {
    add(files, part.name + ".stl", [&](std::ostream& out) { write_stl(out, part.printed); });
    (part.stays ? carrier : mould).push_back({part.name, part.printed, part.copies});
  }
  add(files, "carrier.3mf", [&](std::ostream& out) { write_3mf(out, std::span<const PrintItem>(carrier), Zip{}); });
  add(files, "mould.3mf", [&](std::ostream& out) { write_3mf(out, std::span<const PrintItem>(mould), Zip{}); });
  add(files, "casting_section", section_drawing(s, o));
  add(files, "led_strip", strip_drawing(s, o));
  if (s.design.w_v > 0.0) add(files, "core", core_drawing(s, o));
}

double grams(double volume_m3, double density_kg_per_m3) { return 1e3 * volume_m3 * density_kg_per_m3; }

Json silicone_json(const Silicone& rubber, const CastVolume& volume) {
  const auto mass_g = [&](double volume_m3) { return number(grams(volume_m3, rubber.density_kg_per_m3)); };
  const Json half_g = number(0.5 * reserve * grams(volume.total(), rubber.density_kg_per_m3));
  const std::optional<Silicone> card = find_silicone(rubber.name);
  const bool of_paper = card && rubber.density_kg_per_m3 == card->density_kg_per_m3;
  return {{"density_kg_per_m3", rubber.density_kg_per_m3}, {"source", of_paper ? "paper Table I" : "configuration"},
      {"pad_volume_mm3", number(1e9 * volume.pad)}, {"pad_mass_g", mass_g(volume.pad)},
      {"fits_volume_mm3", number(1e9 * volume.fits)}, {"openings_volume_mm3", number(1e9 * volume.openings)},
      {"cast_volume_mm3", number(1e9 * volume.total())}, {"cast_mass_g", mass_g(volume.total())},
      {"mix", "1A:1B by weight"}, {"reserve_percent", 100.0 * (reserve - 1.0)}, {"part_a_g", half_g},
      {"part_b_g", half_g}};
}

/// The pad's files are added to `files`; what there is to know about them is returned, as text or JSON.
std::string kit_of(const Configuration& asked, bool as_json, Output& files) {
  const Pad& pad_request = asked.pad;
  const HalfSection s = casting_section(pad_request.design(), pad_request.finger.pad);
  const CastingOptions o = asked.casting.made_for(pad_request.finger);
  const Silicone& rubber = pad_request.silicone;
  const std::vector<CastingPart> kit = casting_kit(s, o);
  const CastVolume volume = cast_volume(s, o);
  const std::vector<std::string> remarks = casting_notes(s, o);
  const Vec3d direction = opening_direction();
  const double draft_deg =
      std::min(least_draft(kit[1].assembled, s, direction), least_draft(kit[2].assembled, s, Vec3d(-direction))) *
      180.0 / pi;
  const double cast_g = grams(volume.total(), rubber.density_kg_per_m3), mix_g = reserve * cast_g;

  Json j = heading(pad_request);
  j["options_mm"] = {{"clearance", mm(o.clearance)}, {"plate", mm(CastingLayout(s, o).plate)}, {"wall", mm(o.wall)},
      {"strip_width", mm(o.strip_width)}, {"strip_height", mm(o.strip_height)}, {"gate", mm(o.gate_diameter)},
      {"vent", mm(o.vent_diameter)}};
  j["parts"] = Json::array();
  std::string table = pad("part", -9) + pad("copies", 7) + pad("volume [mm³]", 14) + pad("mass [g]", 10) +
                      "  printed, x × y × z [mm]\n";
  for (const CastingPart& part : kit) {
    const double mass_g = grams(part.volume_m3, print_density_kg_per_m3);
    j["parts"].push_back({{"name", part.name}, {"file", part.name + ".stl"}, {"copies", part.copies},
        {"volume_mm3", number(1e9 * part.volume_m3)}, {"mass_g", number(mass_g)},
        {"box_mm", numbers(std::vector{mm(part.box.x()), mm(part.box.y()), mm(part.box.z())})}});
    table += pad(part.name, -9) + cell(part.copies, 0, 7) + cell(1e9 * part.volume_m3, 0, 13) + cell(mass_g, 1, 10) +
             "  " + short_number(1e3 * part.box.x()) + " × " + short_number(1e3 * part.box.y()) + " × " +
             short_number(1e3 * part.box.z()) + "\n";
  }
  j["print_material"] = {{"name", "PLA"}, {"density_kg_per_m3", print_density_kg_per_m3},
      {"source", "NatureWorks Ingeo 4043D data sheet (ASTM D792); masses are of solid prints"}};
  j["silicone"] = silicone_json(rubber, volume);
  j["opening_direction"] = numbers(std::vector{direction.x(), direction.y(), direction.z()});
  j["least_draft_deg"] = number(draft_deg);
  j["notes"] = remarks;
  j["configuration"] = tree_of(asked);
  const std::string report = j.dump(2) + "\n";

  add_files(s, o, kit, files);
  files.add("fabrication.json", report);
  if (as_json) return report;
  std::string text = theta_text(pad_request) + "\n" + table + "pad " + cell(1e9 * volume.pad, 0) + " mm³, " +
                     cell(grams(volume.pad, rubber.density_kg_per_m3), 1) + " g of " + pad_request.material() + " (" +
                     short_number(rubber.density_kg_per_m3) + " kg/m³); with gate, vents and fits " +
                     cell(1e9 * volume.total(), 0) + " mm³, " + cell(cast_g, 1) + " g\nmix " + cell(0.5 * mix_g, 1) +
                     " g of A and " + cell(0.5 * mix_g, 1) + " g of B: " + short_number(100.0 * (reserve - 1.0)) +
                     " % in reserve\n";
  for (const std::string& remark : remarks) text += "note: " + remark + "\n";
  return text;
}

struct Fabricate : Configured {
  CLI::Option* plate = nullptr;

  void declare(CLI::App& app) {
    declare_configuration(app);
    add_pad(app, effective);
    add_text(app, "--out", out, "DIR", "Directory for the files; made when it is not there")->required();
    const auto length = [&](const char* flag, const std::string& path) {
      const Setting& s = setting(path);
      return add_setting(
          app, effective, flag, path, s.help + " [mm], default " + short_number(s.get(Configuration{}).get<double>()));
    };
    length("--clearance", "casting.clearance_mm");
    plate = length("--plate", "casting.plate_mm");
    length("--wall", "casting.wall_mm");
    length("--strip-width", "casting.strip_width_mm");
    length("--strip-height", "casting.strip_height_mm");
    length("--gate", "casting.gate_mm");
    length("--vent", "casting.vent_mm");
    add_common(app, *this);
  }
  void check() const {
    Configured::check();
    // A whole configuration has a plate even where there is none to choose.
    const bool chosen = plate->count() > 0 || asked().casting.plate != CastingOptions{}.plate;
    if (chosen && asked().pad.finger.pad.shoulder_height > 0.0)
      throw UsageError(
          "casting.plate_mm (--plate) is for a flat carrier; a stair's plate is set by finger.carrier_height_mm and "
          "finger.shoulder_height_mm");
  }
  Result run(Output& files, Progress&) const { return kit_of(asked(), json, files); }
};

}  // namespace

void add_fabricate(CommandLine& line) {
  line.add<Fabricate>("fabricate", "Files to print and cast the finger: carrier, mould, drawings");
}

}  // namespace lumo::program
