#pragma once

namespace lumo {

/// Version of this library, by semantic versioning: before 1.0 a new minor version may break its users, a new patch
/// does not. These three numbers are the only place where it stands; CMake and pkg-config read them here.
inline constexpr int version_major = 0;
inline constexpr int version_minor = 1;
inline constexpr int version_patch = 0;

}  // namespace lumo
