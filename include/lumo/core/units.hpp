#pragma once

namespace lumo {

/// Literals that turn the field's units into SI: `5.0_mm`, `106.0_kPa`, `3.1_dB_per_cm`.
inline namespace literals {

constexpr double operator""_m(long double v) { return double(v); }
constexpr double operator""_mm(long double v) { return double(v * 1e-3L); }
constexpr double operator""_um(long double v) { return double(v * 1e-6L); }
constexpr double operator""_N(long double v) { return double(v); }
constexpr double operator""_Pa(long double v) { return double(v); }
constexpr double operator""_kPa(long double v) { return double(v * 1e3L); }
constexpr double operator""_MPa(long double v) { return double(v * 1e6L); }
constexpr double operator""_W(long double v) { return double(v); }
constexpr double operator""_kg_per_m3(long double v) { return double(v); }
constexpr double operator""_N_per_m3(long double v) { return double(v); }
constexpr double operator""_deg(long double v) { return double(v * 3.14159265358979323846264338327950288L / 180.0L); }
constexpr double operator""_per_m(long double v) { return double(v); }
/// Power attenuation: 10 dB are a factor of ten, so 1 dB/cm = 100 ln(10)/10 per metre.
constexpr double operator""_dB_per_cm(long double v) { return double(v * 23.0258509299404568401799145468436421L); }

}  // namespace literals

inline constexpr double pi = 3.14159265358979323846;

}  // namespace lumo
