#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/joints/contact_jacobian.hpp"

#include <utility>
#include <vector>

namespace lumo {

/// Revolute joints in a row, each with one link that may carry a pad.
template <class Vec3 = Vec3>
class SerialChainOf {
 public:
  using Mat3 = Dependent<lumo::Mat3, Vec3>;
  using Isometry3d = Dependent<Eigen::Isometry3d, Vec3>;
  using AngleAxisd = Dependent<Eigen::AngleAxisd, Vec3>;
  using JointVector = Dependent<lumo::JointVector, Vec3>;

  struct Link {
    Isometry3d joint = Isometry3d::Identity();    ///< pose of the joint's frame in the frame of the link before (or the base), at angle 0
    Vec3 axis = Vec3::UnitX();                    ///< of rotation, in the joint's frame; unit
    Isometry3d finger = Isometry3d::Identity();   ///< pose of the pad's finger frame (y along it, z out of it) in the joint's frame
  };

  /// Throws InvalidArgument for no or too many links, or numbers that make no sense.
  explicit SerialChainOf(std::vector<Link> links) : links_(std::move(links)) {
    if (links_.empty() || links_.size() > std::size_t(max_joints))
      throw InvalidArgument(detail::text("serial chain has ", links_.size(), " links, must have 1 to ", max_joints));
    for (Link& l : links_) {
      if (!l.joint.matrix().allFinite() || !l.finger.matrix().allFinite()) throw InvalidArgument("serial chain: poses must be finite");
      for (const Isometry3d& pose : {l.joint, l.finger})
        if ((pose.linear().transpose() * pose.linear() - Mat3::Identity()).norm() > 1e-6 || pose.linear().determinant() < 0.0)
          throw InvalidArgument("serial chain: poses must turn and move, not stretch or mirror");
      require_positive("length of a joint's axis", l.axis.norm(), "");
      l.axis.normalize();
    }
  }

  int joints() const { return int(links_.size()); }

  JointVector column(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c.link);
    const Isometry3d& finger = p.finger;
    return torques(p, finger * Vec3(0.0, c.y_m, 0.0), finger.linear().col(2), true);
  }
  JointVector slope(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c.link);
    const Isometry3d& finger = p.finger;
    return torques(p, finger.linear().col(1), finger.linear().col(2), false);
  }
  /// Where the contact is, in the base's frame [m].
  Vec3 position(const JointVector& q, const ContactPoint& c) const { return pose(q, c.link).finger * Vec3(0.0, c.y_m, 0.0); }
  /// Outward normal of the pad there, in the base's frame.
  Vec3 normal(const JointVector& q, const ContactPoint& c) const {
    const Isometry3d finger = pose(q, c.link).finger;
    return finger.linear().col(2);
  }

 private:
  struct Pose {
    Eigen::Matrix<typename Vec3::Scalar, 3, Eigen::Dynamic, Eigen::ColMajor, 3, max_joints> axis, origin;  ///< of the joints up to the contact's
    Isometry3d finger;
  };

  Pose pose(const JointVector& q, int link) const {
    if (link < 0 || link >= joints()) throw InvalidArgument(detail::text("contact lies on link ", link, ", the chain has ", joints()));
    if (q.size() != joints()) throw InvalidArgument(detail::text("chain has ", joints(), " joints, got ", q.size(), " angles"));
    Pose p;
    p.axis.resize(3, link + 1);
    p.origin.resize(3, link + 1);
    Isometry3d frame = Isometry3d::Identity();
    for (int i = 0; i <= link; ++i) {
      const Link& l = links_[std::size_t(i)];
      frame = frame * l.joint;
      p.axis.col(i) = frame.linear() * l.axis;
      p.origin.col(i) = frame.translation();
      frame.rotate(AngleAxisd(q[i], l.axis));
    }
    p.finger = frame * links_[std::size_t(link)].finger;
    return p;
  }

  /// The motors balance a force −n at `place`: axis · ((place − origin) × n). Directions have no origin.
  JointVector torques(const Pose& p, const Vec3& place, const Vec3& n, bool is_place) const {
    JointVector t = JointVector::Zero(joints());
    for (Eigen::Index i = 0; i < p.axis.cols(); ++i) {
      const Vec3 arm = is_place ? Vec3(place - p.origin.col(i)) : place;
      t[i] = p.axis.col(i).dot(arm.cross(n));
    }
    return t;
  }

  std::vector<Link> links_;
};

using SerialChain = SerialChainOf<>;

static_assert(ContactJacobian<SerialChain>);

}  // namespace lumo
