/* Forward dynamics of an arm by Pinocchio's C++: nanoseconds per evaluation, and where the arm then is.
 *
 *     pinocchio_dynamics EVALUATIONS < numbers
 *
 * The numbers: how many joints; for each its parent, 1 if it turns and 0 if it slides, 9 of its rotation by rows, 3 of
 * its place, mass, 3 of the centre, 9 of the inertia about the centre, armature; then gravity, q, v and tau. */
#include <chrono>
#include <cstdio>
#include <cstdlib>

#include <pinocchio/multibody.hpp>
#include <pinocchio/algorithm/aba.hpp>

static double number()
{
    double value = 0;
    if (std::scanf("%lf", &value) != 1)
        std::exit(1);
    return value;
}

template <typename Matrix> static void fill(Matrix &&matrix)
{
    for (int i = 0; i < matrix.rows(); ++i)
        for (int j = 0; j < matrix.cols(); ++j)
            matrix(i, j) = number();
}

int main(int, char **words)
{
    pinocchio::Model model;
    const int joints = static_cast<int>(number());
    Eigen::VectorXd armature(joints);
    for (int i = 0; i < joints; ++i) {
        const auto parent = static_cast<pinocchio::JointIndex>(number() + 1);
        const bool turns = number() != 0;
        pinocchio::SE3 place;
        Eigen::Vector3d center;
        Eigen::Matrix3d inertia;
        fill(place.rotation());
        fill(place.translation());
        const double mass = number();
        fill(center);
        fill(inertia);
        armature[i] = number();
        const std::string name = "joint" + std::to_string(i);
        const auto joint = turns ? model.addJoint(parent, pinocchio::JointModelRZ(), place, name)
                                 : model.addJoint(parent, pinocchio::JointModelPZ(), place, name);
        model.appendBodyToJoint(joint, pinocchio::Inertia(mass, center, inertia));
    }
    model.armature = armature;
    Eigen::Vector3d gravity;
    fill(gravity);
    model.gravity.linear(gravity);
    Eigen::VectorXd q(joints), v(joints), tau(joints);
    fill(q);
    fill(v);
    fill(tau);
    pinocchio::Data data(model);
    const int evaluations = std::atoi(words[1]);
    const auto started = std::chrono::steady_clock::now();
    for (int i = 0; i < evaluations; ++i) {
        pinocchio::aba(model, data, q, v, tau);
        q += 1e-6 * v;
        v += 1e-6 * data.ddq;
    }
    const std::chrono::duration<double, std::nano> spent = std::chrono::steady_clock::now() - started;
    std::printf("%.3f %.17g\n", spent.count() / evaluations, q.sum());
    return 0;
}
