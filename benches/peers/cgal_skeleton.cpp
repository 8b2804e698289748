// CGAL's mean curvature skeleton with its defaults; `skeletons.py` compiles and runs this.
//
//     cgal_skeleton MESH.obj CURVES.obj
//
// Prints the CPU seconds without those of reading; writes lines `v x y z` and `l from to`.
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/extract_mean_curvature_flow_skeleton.h>

#include <cstdio>
#include <ctime>

typedef CGAL::Surface_mesh<CGAL::Simple_cartesian<double>::Point_3> Mesh;
typedef CGAL::Mean_curvature_flow_skeletonization<Mesh>::Skeleton Skeleton;

double cpu_secs()
{
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return time.tv_sec + time.tv_nsec * 1e-9;
}

int main(int argc, char **argv)
{
    Mesh mesh;
    if (argc != 3 || !CGAL::IO::read_polygon_mesh(argv[1], mesh) || !CGAL::is_closed(mesh)) {
        fprintf(stderr, "usage: cgal_skeleton CLOSED_MESH.obj CURVES.obj\n");
        return 1;
    }
    double start = cpu_secs();
    Skeleton skeleton;
    CGAL::extract_mean_curvature_flow_skeleton(mesh, skeleton);
    printf("%.3f %d %d\n", cpu_secs() - start, int(num_vertices(skeleton)), int(num_edges(skeleton)));
    FILE *file = fopen(argv[2], "w");
    if (!file)
        return 1;
    for (auto it : CGAL::make_range(vertices(skeleton)))
        fprintf(file, "v %.17g %.17g %.17g\n", skeleton[it].point.x(), skeleton[it].point.y(), skeleton[it].point.z());
    for (auto it : CGAL::make_range(edges(skeleton)))
        fprintf(file, "l %d %d\n", int(source(it, skeleton)) + 1, int(target(it, skeleton)) + 1);
    return fclose(file) == 0 ? 0 : 1;
}
