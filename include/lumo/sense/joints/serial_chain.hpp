#pragma once

#include "lumo/core/error.hpp"
#include "lumo/core/types.hpp"
#include "lumo/sense/joints/contact_jacobian.hpp"

#include <utility>
#include <vector>

namespace lumo::sense {

/// Revolute joints in a row, each with one link that may carry a pad.
class SerialChain {
 public:
  struct Link {
    Eigen::Isometry3d joint = Eigen::Isometry3d::Identity();   ///< pose of the joint's frame in the frame of the link
                                                               ///< before (or the base), at angle 0
    Vec3d axis = Vec3d::UnitX();                               ///< of rotation, in the joint's frame; unit
    Eigen::Isometry3d finger = Eigen::Isometry3d::Identity();  ///< pose of the pad's finger frame (y along it, z out of
                                                               ///< it) in the joint's frame
  };

  /// Throws InvalidArgument for no or too many links, or numbers out of range.
  explicit SerialChain(std::vector<Link> links) : links_(std::move(links)) {
    if (links_.empty() || links_.size() > std::size_t(max_joints))
      throw InvalidArgument(message("serial chain has ", links_.size(), " links, must have 1 to ", max_joints));
    for (Link& l : links_) {
      if (!l.joint.matrix().allFinite() || !l.finger.matrix().allFinite())
        throw InvalidArgument("serial chain: poses must be finite");
      for (const Eigen::Isometry3d& pose : {l.joint, l.finger})
        if ((pose.linear().transpose() * pose.linear() - Mat3d::Identity()).norm() > 1e-6 ||
            pose.linear().determinant() < 0.0)
          throw InvalidArgument("serial chain: poses must turn and move, not stretch or mirror");
      require_positive("length of a joint's axis", l.axis.norm(), "");
      l.axis.normalize();
    }
  }

  int joints() const { return int(links_.size()); }

  JointVector column(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c);
    const Eigen::Isometry3d& finger = p.finger;
    return torques(p, finger * Vec3d(0.0, c.y_m, 0.0), finger.linear().col(2), true);
  }
  JointVector slope(const JointVector& q, const ContactPoint& c) const {
    const Pose p = pose(q, c);
    const Eigen::Isometry3d& finger = p.finger;
    return torques(p, finger.linear().col(1), finger.linear().col(2), false);
  }
  /// Where the contact is, in the base's frame [m].
  Vec3d position(const JointVector& q, const ContactPoint& c) const {
    return pose(q, c).finger * Vec3d(0.0, c.y_m, 0.0);
  }
  /// Outward normal of the pad there, in the base's frame.
  Vec3d normal(const JointVector& q, const ContactPoint& c) const {
    const Eigen::Isometry3d finger = pose(q, c).finger;
    return finger.linear().col(2);
  }

 private:
  struct Pose {
    Eigen::Matrix<double, 3, Eigen::Dynamic, Eigen::ColMajor, 3, max_joints> axis,
        origin;  ///< of the joints up to the contact's
    Eigen::Isometry3d finger;
  };

  Pose pose(const JointVector& q, const ContactPoint& c) const {
    const int link = c.link;
    if (link < 0 || link >= joints())
      throw InvalidArgument(message("contact lies on link ", link, ", the chain has ", joints()));
    if (q.size() != joints())
      throw InvalidArgument(message("chain has ", joints(), " joints, got ", q.size(), " angles"));
    require_finite_pose(q, c);
    Pose p;
    p.axis.resize(3, link + 1);
    p.origin.resize(3, link + 1);
    Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
    for (int i = 0; i <= link; ++i) {
      const Link& l = links_[std::size_t(i)];
      frame = frame * l.joint;
      p.axis.col(i) = frame.linear() * l.axis;
      p.origin.col(i) = frame.translation();
      frame.rotate(Eigen::AngleAxisd(q[i], l.axis));
    }
    p.finger = frame * links_[std::size_t(link)].finger;
    return p;
  }

  /// The motors balance a force −n at `place`: axis · ((place − origin) × n). Directions have no origin.
  JointVector torques(const Pose& p, const Vec3d& place, const Vec3d& n, bool is_place) const {
    JointVector t = JointVector::Zero(joints());
    for (Eigen::Index i = 0; i < p.axis.cols(); ++i) {
      const Vec3d arm = is_place ? Vec3d(place - p.origin.col(i)) : place;
      t[i] = p.axis.col(i).dot(arm.cross(n));
    }
    return t;
  }

  std::vector<Link> links_;
};

static_assert(ContactJacobian<SerialChain>);

}  // namespace lumo::sense
