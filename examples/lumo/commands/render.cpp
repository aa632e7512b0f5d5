#include "commands/pressing.hpp"
#include "computing/picture.hpp"
#include "report/present.hpp"
#include "report/records.hpp"
#include "sensing/pictures.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>

namespace lumo::program {

namespace {

/// Portable float map: grey, little-endian, rows from the bottom.
std::string pfm(const std::vector<double>& values, int columns, int rows) {
  static_assert(std::endian::native == std::endian::little);
  std::string text = lumo::message("Pf\n", columns, " ", rows, "\n-1.0\n");
  for (int row = rows - 1; row >= 0; --row)
    for (int column = 0; column < columns; ++column) {
      const auto value = float(values[std::size_t(row) * std::size_t(columns) + std::size_t(column)]);
      std::array<char, sizeof value> bytes{};
      std::memcpy(bytes.data(), &value, sizeof value);
      text.append(bytes.data(), bytes.size());
    }
  return text;
}

double part_of(std::vector<double> values, double part) {
  const auto k = std::ptrdiff_t(part * double(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + k, values.end());
  return values[std::size_t(k)];
}

/// The exposure at which all but the brightest pixels of the unloaded picture, as of lamps, stay below full.
double automatic_exposure_ms(CameraSettings camera, const Picture& unloaded) {
  constexpr double brightest_part = 0.98, wanted_DN = 220.0, least_ms = 1e-3, most_ms = 1e4;
  const double bright = part_of(unloaded.radiance, brightest_part);
  camera.exposure_ms = 1.0;
  const double room_DN = wanted_DN - digital_number(camera, 0.0), per_ms = numbers_per_radiance(camera);
  return bright > 0.0 ? std::clamp(room_DN / (per_ms * bright), least_ms, most_ms) : most_ms;
}

/// 1, 2 or 5 times a power of ten, not below `value`.
double round_up(double value) {
  if (!(value > 0.0)) return 1.0;
  const double ten = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0})
    if (value <= step * ten * (1.0 + 1e-9)) return step * ten;
  return 10.0 * ten;
}

std::string load_name(double load_N) {
  std::string name = short_number(load_N, 6);
  std::replace(name.begin(), name.end(), '.', 'p');
  return name + "N";
}

/// A mean over pixels, of which errors are independent.
Estimate mean_of(const std::vector<double>& values, const std::vector<double>& errors) {
  const double n = double(values.size());
  return {std::accumulate(values.begin(), values.end(), 0.0) / n,
      std::sqrt(std::inner_product(errors.begin(), errors.end(), errors.begin(), 0.0)) / n};
}

struct Render : DesignCommand {
  bool automatic = true, maps = false;
  double range = 0.0;  ///< of false colours; 0: as the picture asks

  Render() {
    Configuration defaults;
    defaults.touch.loads_N = {10.0};
    effective = Effective(defaults);
  }

  void declare(CLI::App& app) {
    declare_common(app);
    add_approach(app, effective);
    add_setting(
        app, effective, "--load", "contact.loads_N", "Load, or increasing loads, a picture each [N], default 10");
    declare_camera(app);
    add_mechanics(app, effective);
    add_time_limit(app, effective);
    app.footer(
        "DIR gets unloaded.png, a pressed_LOADN.png and a difference_LOADN.png for each load. The camera is aimed at "
        "the middle of the side x > 0 and, by default, stands where the virtual lab's does. The sphere itself is not "
        "drawn: where it touches, the pad is black.");
  }
  void declare_camera(CLI::App& app) {
    add_setting(app, effective, "--distance", "camera.distance_mm", "Of the camera from the side [mm], default 250");
    add_setting(app, effective, "--yaw", "camera.yaw_deg", "It stands towards +y by this angle [deg], default 0");
    add_setting(app, effective, "--pitch", "camera.pitch_deg", "It looks down by this angle [deg], default 0");
    add_setting(app, effective, "--roll", "camera.roll_deg", "About its line of sight [deg], default 0");
    add_value(
        app, "--pixels", "N,N", "Columns and rows of the picture [px], default 192,80", [this](const std::string& t) {
          const auto fields = split(t);
          if (fields.size() != 2) throw UsageError("--pixels is " + in_quotes(t) + ", must be columns,rows [px]");
          effective.type("--pixels", "camera.columns", std::string(fields[0]));
          effective.type("--pixels", "camera.rows", std::string(fields[1]));
        });
    add_setting(app, effective, "--focal", "camera.focal_px", "Focal length [px], default 616");
    add_value(
        app, "--fov", "N", "Field of view across all columns, in place of --focal [deg]", [this](const std::string& t) {
          const double half = 0.5 * number_in("--fov", t, {0.1, 170.0}, "deg") * pi / 180.0;
          effective.type("--fov", "camera.focal_px", Json(0.5 * effective->camera.columns / std::tan(half)).dump());
        });
    add_setting(app, effective, "--aperture", "camera.aperture_mm", "Radius of the lens' opening [mm], default 0.48");
    add_value(app, "--exposure", "N", "Exposure [ms], one scale for all pads; default auto: by the unloaded picture",
        [this](const std::string& t) {
          automatic = t == "auto";
          if (!automatic) effective.type("--exposure", "camera.exposure_ms", t);
        });
    add_setting(app, effective, "--gain", "camera.gain", "Gain, default 64");
    add_setting(app, effective, "--samples", "camera.samples", "Lines of sight a pixel, default 16");
    add_value(app, "--range", "N", "Change of the strongest false colour [1/(m2 sr)], default: by the picture",
        [this](const std::string& t) {
          range = number_in("--range", t, {1e-9, 1e9}, "1/(m2 sr)");
        });
    add_flag(app, "--radiance", maps, "Also radiance per emitted power [1/(m2 sr)], as portable float maps (.pfm)");
  }
  void check() const {
    Configured::check();
    const int samples = asked().camera.samples;
    if (samples % 8 != 0 && (samples > 4 || !std::has_single_bit(unsigned(samples))))
      throw UsageError(lumo::message("--samples is ", samples, ", must be 1, 2, 4 or a multiple of 8"));
    if (out) pictures();
  }

  Result run(Output& files, Progress& progress) const {
    RenderResult result = make_render(asked(), threads, progress);
    Configuration used = asked();
    if (automatic && !result.pictures.empty())
      used.camera.exposure_ms = automatic_exposure_ms(used.camera, result.pictures.front());
    for (const Picture& p : result.pictures) {
      const std::string name = p.load_N > 0.0 ? "pressed_" + load_name(p.load_N) : "unloaded";
      if (files.wanted()) files.add(name + ".png", grey_png(used.camera, p));
      if (files.wanted() && p.load_N > 0.0)
        files.add("difference_" + load_name(p.load_N) + ".png", difference_png(used, p));
      if (maps) files.add(name + ".pfm", pfm(p.radiance, used.camera.columns, used.camera.rows));
    }
    return {json ? json_of(used, result) : text_of(used, result), failure_of(asked(), {result.press})};
  }

  static std::string grey_png(const CameraSettings& camera, const Picture& p) {
    sense::Image image = sense::Image::black(camera.columns, camera.rows, sense::PixelFormat::grey);
    for (std::size_t k = 0; k < p.radiance.size(); ++k)
      image.pixels[k] = std::uint8_t(std::lround(digital_number(camera, p.radiance[k])));
    const auto bytes = pictures().encode(".png", image.view());
    return {bytes.begin(), bytes.end()};
  }
  std::string difference_png(const Configuration& used, const Picture& p) const {
    constexpr double strong_part = 0.99;  // of the pixels that change: lamps change a thousand times as much
    std::vector<double> size;
    for (const double v : p.change)
      if (v != 0.0) size.push_back(std::abs(v));
    const double strongest = range > 0.0 ? range : size.empty() ? 1.0 : round_up(part_of(size, strong_part));
    FalseColour f;
    f.columns = used.camera.columns;
    f.rows = used.camera.rows;
    f.values = p.change;
    f.range = strongest;
    f.decimals = std::clamp(1 - int(std::floor(std::log10(0.25 * strongest))), 0, 9);
    f.title = "Change of radiance per emitted power at " + short_number(p.load_N) + " N";
    f.subtitle = "theta = " + joined(used.pad.theta_mm) + " mm, " + used.pad.material() + "; sphere " +
                 short_number(used.touch.diameter_mm) + " mm at y = " + short_number(used.touch.y_mm) +
                 " mm; colours grow as the root of the change";
    f.unit = "[1/(m2 sr)]";
    return pictures().false_colour(f);
  }

  static double saturated(const CameraSettings& camera, const Picture& p) {
    constexpr double full_DN = 255.0;
    return double(std::count_if(p.radiance.begin(), p.radiance.end(), [&](double v) {
      return digital_number(camera, v) >= full_DN;
    })) / double(p.radiance.size());
  }
  static std::string text_of(const Configuration& used, const RenderResult& r) {
    std::string text = theta_text(used.pad) + "; " + scenario_text(r.press) + "\n";
    if (r.pictures.empty()) return text;
    text += lumo::message("picture of ", r.columns, " x ", r.rows, " px, exposure ",
        short_number(used.camera.exposure_ms, 4), " ms, gain ", short_number(used.camera.gain), "\n");
    text += "load [N]  mean DN  full [%]  mean radiance per emitted power [1/(m² sr)]   change\n";
    for (const Picture& p : r.pictures) {
      const Estimate light = mean_of(p.radiance, p.error), change = mean_of(p.change, p.change_error);
      double DN = 0.0;
      for (const double v : p.radiance) DN += digital_number(used.camera, v) / double(p.radiance.size());
      text += cell(p.load_N, 2, 8) + cell(DN, 1, 9) + cell(100.0 * saturated(used.camera, p), 2, 10) +
              cell(light.value, 4, 18) + " ± " + cell(light.error, 4, 6);
      text += p.load_N > 0.0 ? cell(change.value, 4, 21) + " ± " + cell(change.error, 4) + "\n" : "\n";
    }
    return text + std::to_string(r.nodes) + " nodes, " + std::to_string(r.elements) + " tetrahedra; " +
           cell(r.seconds, 1) + " s in all\n";
  }
  static std::string json_of(const Configuration& used, const RenderResult& r) {
    Json j = heading(used.pad);
    append(j, program::json(r.press));
    j["pictures"] = Json::array();
    for (const Picture& p : r.pictures) {
      const Estimate light = mean_of(p.radiance, p.error), change = mean_of(p.change, p.change_error);
      Json& one = j["pictures"].emplace_back();
      one = {{"load_N", p.load_N}, {"mean_radiance_per_m2_sr", number(light.value)},
          {"mean_radiance_per_m2_sr_err", number(light.error)}, {"saturated", number(saturated(used.camera, p))}};
      if (p.load_N > 0.0)
        append(one,
            {{"mean_change_per_m2_sr", number(change.value)}, {"mean_change_per_m2_sr_err", number(change.error)}});
    }
    if (!r.pictures.empty()) j["ledger"] = program::json(r.ledger);
    j["mesh"] = mesh_size(r.nodes, r.elements);
    j["seconds"] = number(r.seconds);
    j["configuration"] = tree_of(used);
    return j.dump(2) + "\n";
  }
};

}  // namespace

void add_render(CommandLine& line) {
  line.add<Render>("render", "What a camera sees of the lit pad, unloaded and pressed, and the difference");
}

}  // namespace lumo::program
