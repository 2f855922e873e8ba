// An arm: an immutable tree of links, which is a chain unless seats are given.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "flexarm/contact.hpp"
#include "flexarm/link.hpp"
#include "flexarm/loop.hpp"
#include "flexarm/made_once.hpp"
#include "flexarm/strut.hpp"

namespace flexarm {

// Eigen allocates and aligns its data as the vector flags (-mavx, -march=native) and the address sanitizer
// of a file have it. A program whose files disagree with the library on that crashes; by these names it does not link
// instead. Then compile the library with the flags of the program: as a part of its project, or by -DCMAKE_CXX_FLAGS=.
#define FLEXARM_JOIN_(a, b) a##b
#define FLEXARM_JOIN(a, b) FLEXARM_JOIN_(a, b)
#define FLEXARM_SAME_VECTORS FLEXARM_JOIN(aligned_to_, EIGEN_DEFAULT_ALIGN_BYTES)
#if EIGEN_DEFAULT_ALIGN_BYTES == 16 && !EIGEN_MALLOC_ALREADY_ALIGNED
#define FLEXARM_SAME_MALLOC by_eigen
#else
#define FLEXARM_SAME_MALLOC by_the_system
#endif
namespace this_file_has_other_vector_flags_than_the_flexarm_library {
extern const char FLEXARM_SAME_VECTORS;
}
namespace this_file_has_other_sanitizers_than_the_flexarm_library {
extern const char FLEXARM_SAME_MALLOC;
}
#if defined(__GNUC__)
[[gnu::used]] static const char* const flexarm_flags_are_those_of_the_library[] = {
    &this_file_has_other_vector_flags_than_the_flexarm_library::FLEXARM_SAME_VECTORS,
    &this_file_has_other_sanitizers_than_the_flexarm_library::FLEXARM_SAME_MALLOC};
#endif

class Arm {
 public:
  static constexpr int kWorld = -1;

  /// The seat of a joint: a link, at its end or on the slice at so many metres along its beam; or the world.
  struct Seat {
    int link;
    std::optional<double> at;
    Seat(int number = kWorld, std::optional<double> x = {}) : link(number), at(x) {}
    bool operator==(const Seat& other) const { return link == other.link && at == other.at; }
  };

  /// @param gravity  world axes (m/s^2); a joint on the world sits at its origin, in its axes
  /// @param seats  of each link, that of its joint: on a link before it, or kWorld. Empty: a chain
  /// @param struts struts and tendons between points of the links and of the world
  /// @param contacts of points of the links with surfaces
  /// @param loops  joints that close loops of the tree
  /// @throws std::invalid_argument naming the field and the value, also for a coordinate without inertia
  explicit Arm(std::vector<Link> links, const Eigen::Vector3d& gravity = Eigen::Vector3d::Zero(),
               std::vector<Seat> seats = {}, std::vector<Strut> struts = {}, std::vector<Contact> contacts = {},
               std::vector<Loop> loops = {});

  const std::vector<Link>& links() const { return links_; }
  std::size_t size() const { return links_.size(); }
  const Link& link(std::size_t n) const { return links_[n]; }
  /// The link on which link n sits, or kWorld.
  int parent(std::size_t n) const { return seats_[n].link; }
  /// Where along the beam there (m); none: on the end.
  const std::optional<double>& at(std::size_t n) const { return seats_[n].at; }
  const std::vector<Seat>& seats() const { return seats_; }
  const std::vector<Strut>& struts() const { return struts_; }
  const std::vector<Contact>& contacts() const { return contacts_; }
  const std::vector<Loop>& loops() const { return loops_; }
  /// Whether any contact has friction, which depends on the way that it has come.
  bool has_contact_friction() const;
  /// Whether every link sits on the end of the one before it.
  bool is_chain() const;
  const Eigen::Vector3d& gravity() const { return gravity_; }
  int nq() const { return nq_; }  ///< nv, and one more for each ball
  int nv() const { return nv_; }
  int first(std::size_t n) const { return first_[n]; }      ///< first rate of link n: joint, then elastic (Eq. 33)
  int first_q(std::size_t n) const { return first_q_[n]; }  ///< first coordinate of link n
  /// Coordinate whose rate is rate i, or -1 for the rates of a ball.
  int coordinate_of(int i) const { return coordinate_of_[i]; }
  /// All coordinates zero, balls at 1 0 0 0.
  Eigen::VectorXd zero() const;
  /// Generalised forces of all patches per volt (Eq. 61), nv x their number, in the order of links and patches.
  Eigen::MatrixXd patch_matrix() const;
  /// A label per rate, such as "link 0 bending_y 1".
  std::vector<std::string> coordinates() const;
  /// Sizes of coordinates (nq) and rates (nv) far beyond any real motion: elastic coordinates that by themselves
  /// move a section by 10 times the beam's length (1000 times where the rotation is exact: coils) or turn it by 1e4
  /// rad, and joints at 1e12 rad/s or m/s. The largest double for all others: joint coordinates have no limit.
  const Eigen::VectorXd& farthest() const { return farthest_; }
  const Eigen::VectorXd& fastest() const { return fastest_; }
  /// Whether all are finite and below those: else the motion has diverged.
  bool within_reach(const Eigen::VectorXd& q, const Eigen::VectorXd& v) const {
    return (q.array().abs() <= farthest_.array()).all() && (v.array().abs() <= fastest_.array()).all();
  }
  /// The beam or joint nearest to those, or farthest beyond, in words; empty if none is near.
  std::string farthest_out(const Eigen::VectorXd& q, const Eigen::VectorXd& v) const;
  /// A slot for the data that a higher room derives from the arm.
  const MadeOnce& kept() const { return kept_; }

 private:
  void check(const Strut::Point& point, const std::string& name) const;
  void check(const Strut& strut, const std::string& name) const;
  void check(const Contact& contact, const std::string& name) const;
  void check(const Loop& loop, const std::string& name) const;
  void check_seat(std::size_t n) const;
  /// Every coordinate must move some inertia, or no force law gives its acceleration.
  void check_inertia() const;  // inertia_check.cpp

  std::vector<Link> links_;
  Eigen::Vector3d gravity_;
  std::vector<Seat> seats_;
  std::vector<int> first_, first_q_, coordinate_of_;
  std::vector<Strut> struts_;
  std::vector<Contact> contacts_;
  std::vector<Loop> loops_;
  int nq_ = 0, nv_ = 0;
  Eigen::VectorXd farthest_, fastest_;
  MadeOnce kept_;
};

}  // namespace flexarm
