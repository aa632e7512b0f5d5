#pragma once

#include "lumo/core/error.hpp"
#include "lumo/fabrication/three_mf.hpp"

#include <zip.h>

#include <memory>
#include <span>
#include <string>

namespace lumo {

/// Packs files with libzip, in memory. Not compressed, so that the bytes depend on no version of a compressor, and
/// dated 1980-01-01.
class Zip {
 public:
  std::string pack(std::span<const ArchivedFile> files) const;

 private:
  [[noreturn]] static void refuse(const std::string& why) { throw InputError("cannot pack files: " + why); }
};

static_assert(Archiver<Zip>);

inline std::string Zip::pack(std::span<const ArchivedFile> files) const {
  zip_error_t error;
  zip_error_init(&error);
  const std::unique_ptr<zip_source_t, void (*)(zip_source_t*)> buffer(
      zip_source_buffer_create(nullptr, 0, 0, &error), zip_source_free);
  if (!buffer) refuse(zip_error_strerror(&error));
  zip_t* const opened = zip_open_from_source(buffer.get(), ZIP_TRUNCATE, &error);
  if (opened == nullptr) refuse(zip_error_strerror(&error));
  zip_source_keep(buffer.get());  // the archive frees its own hold
  std::unique_ptr<zip_t, void (*)(zip_t*)> archive(opened, zip_discard);
  const auto demand = [&archive](bool done) {
    if (!done) refuse(zip_strerror(archive.get()));
  };
  for (const ArchivedFile& f : files) {
    zip_source_t* const source = zip_source_buffer(archive.get(), f.contents.data(), f.contents.size(), 0);
    demand(source != nullptr);
    const zip_int64_t index = zip_file_add(archive.get(), f.name.c_str(), source, ZIP_FL_ENC_UTF_8);
    if (index < 0) zip_source_free(source);
    demand(index >= 0);
    demand(zip_set_file_compression(archive.get(), zip_uint64_t(index), ZIP_CM_STORE, 0) == 0);
    demand(zip_file_set_dostime(archive.get(), zip_uint64_t(index), 0, 1 << 5 | 1, 0) == 0);
  }
  demand(zip_close(archive.get()) == 0);
  archive.release();

  std::string bytes;
  zip_stat_t stat;
  if (zip_source_stat(buffer.get(), &stat) != 0 || (stat.valid & ZIP_STAT_SIZE) == 0 ||
      zip_source_open(buffer.get()) != 0)
    refuse("the archive cannot be read back");
  bytes.resize(stat.size);
  const zip_int64_t read = zip_source_read(buffer.get(), bytes.data(), bytes.size());
  zip_source_close(buffer.get());
  if (read != zip_int64_t(bytes.size())) refuse("the archive cannot be read back");
  return bytes;
}

}  // namespace lumo
