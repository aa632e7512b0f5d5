#pragma once

#include "catch.hpp"
#include "lumo/morphology/body.hpp"

#include <map>
#include <utility>

/// Each edge of a closed, outward surface is run along once each way.
inline void check_closed(const lumo::Body& body) {
  std::map<std::pair<int, int>, int> edges;
  for (const lumo::Facet& f : body.facets)
    for (std::size_t k = 0; k < f.loop.size(); ++k) ++edges[{f.loop[k], f.loop[(k + 1) % f.loop.size()]}];
  for (const auto& [edge, count] : edges) {
    CHECK(count == 1);
    CHECK(edges.count({edge.second, edge.first}) == 1);
  }
}
