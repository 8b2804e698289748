// Times Pinocchio step by step: `pinocchio.py` builds this against its library and reads what it prints.
//
//     pinocchio joints SKELETON                              lines `name,parent,x,y,z`
//     pinocchio rig SKELETON MESH.obj SCALE                  lines `seconds STEP CPU_SECS` and `joint NAME X Y Z`
//
// SKELETON is one of its own: `human`, `quad`, `horse`. SCALE is the option `-scale` of its program.
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string>

#include "pinocchioApi.h"

namespace {

double cpu_secs()
{
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return time.tv_sec + time.tv_nsec * 1e-9;
}

// Opens the names of joints, which its skeletons keep to themselves.
template <class Own> struct Named : Own {
    std::string name(int joint) const
    {
        for (std::map<std::string, int>::const_iterator it = this->jointNames.begin();
             it != this->jointNames.end(); ++it)
            if (it->second == joint)
                return it->first;
        return "";
    }
};

struct Clock {
    double start, last;
    Clock() : start(cpu_secs()), last(start) {}

    void tell(const char *step)
    {
        double now = cpu_secs();
        printf("seconds %s %.4f\n", step, now - last);
        last = cpu_secs();
    }
};

template <class Own> int joints()
{
    Named<Own> skeleton;
    for (int joint = 0; joint < int(skeleton.fPrev().size()); ++joint) {
        const Vector3 &at = skeleton.fGraph().verts[joint];
        int parent = skeleton.fPrev()[joint];
        printf("%s,%s,%.9g,%.9g,%.9g\n", skeleton.name(joint).c_str(),
               parent < 0 ? "" : skeleton.name(parent).c_str(), at[0], at[1], at[2]);
    }
    return 0;
}

template <class Own> int rig(const char *path, double scale)
{
    Clock clock;
    Mesh given(path);
    clock.tell("read");
    Mesh mesh = prepareMesh(given);
    if (mesh.vertices.empty()) {
        fprintf(stderr, "%s: Pinocchio takes one connected, oriented surface only\n", path);
        return 1;
    }
    Named<Own> skeleton;
    skeleton.scale(scale * 0.7);
    clock.tell("prepare");
    TreeType *field = constructDistanceField(mesh);
    clock.tell("field");
    vector<Sphere> medial = sampleMedialSurface(field);
    vector<Sphere> spheres = packSpheres(medial);
    PtGraph graph = connectSamples(field, spheres);
    clock.tell("spheres");
    vector<int> found = discreteEmbed(graph, spheres, skeleton, computePossibilities(graph, spheres, skeleton));
    clock.tell("search");
    if (found.empty()) {
        fprintf(stderr, "%s: Pinocchio finds no embedding\n", path);
        return 1;
    }
    vector<Vector3> centers;
    for (size_t it = 0; it < medial.size(); ++it)
        centers.push_back(medial[it].center);
    vector<Vector3> places = refineEmbedding(field, centers, splitPaths(found, graph, skeleton), skeleton);
    clock.tell("refine");
    {
        VisTester<TreeType> tester(field);
        Attachment attachment(mesh, skeleton, places, &tester);
        clock.tell("weights");
    }
    printf("vertices %d\nspheres %d\n", int(mesh.vertices.size()), int(spheres.size()));
    for (size_t joint = 0; joint < places.size(); ++joint) {
        Vector3 at = (places[joint] - mesh.toAdd) / mesh.scale;
        printf("joint %s %.9g %.9g %.9g\n", skeleton.name(joint).c_str(), at[0], at[1], at[2]);
    }
    return 0;
}

template <class Own> int run(int argc, char **argv)
{
    if (std::string(argv[1]) == "joints")
        return joints<Own>();
    return argc < 5 ? 2 : rig<Own>(argv[3], atof(argv[4]));
}

} // namespace

int main(int argc, char **argv)
{
    std::string skeleton = argc > 2 ? argv[2] : "";
    if (skeleton == "human")
        return run<HumanSkeleton>(argc, argv);
    if (skeleton == "quad")
        return run<QuadSkeleton>(argc, argv);
    if (skeleton == "horse")
        return run<HorseSkeleton>(argc, argv);
    fprintf(stderr, "usage: pinocchio joints|rig human|quad|horse [MESH.obj SCALE]\n");
    return 2;
}
