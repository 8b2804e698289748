"""pyFM on our bases and descriptors, and the comparison of its maps with ours."""

import numpy as np


def fit_and_refine(
    source_mesh,
    target_mesh,
    source_basis,
    target_basis,
    source_descriptors,
    target_descriptors,
    k_start,
    k,
    step,
):
    """A functional map by pyFM, then ZoomOut by pyFM.

    pyFM's map goes from functions on its first mesh to functions on its second, ours from the target to
    the source: the target is the first.
    """
    from pyFM.functional import FunctionalMapping
    from pyFM.refine import zoomout_refine

    model = FunctionalMapping(
        shape(target_mesh, target_basis), shape(source_mesh, source_basis)
    )
    # At total area one, columns of unit norm are longer by the root of the area, as everywhere in ours.
    model.add_descriptors(target_descriptors.values, source_descriptors.values, normalize=False)
    # The energy of Nogneng & Ovsjanikov 2017 with the weights of `fmap`; pyFM's own defaults have since
    # become others (a mask by the resolvent, and normalized terms). It stops early unless it is told.
    model.fit(
        K=(k_start, k_start),
        w_descr=0.1,
        w_dcomm=1.0,
        w_lap=1e-3,
        use_resolvent_laplacian=False,
        normalize_weights=False,
        optinit="zeros",
        factr=1.0,
        pgtol=1e-12,
    )
    refined, matches = zoomout_refine(
        model.FM,
        model.mesh1.eigenvectors,
        model.mesh2.eigenvectors,
        nit=(k - k_start) // step,
        step=step,
        A2=model.mesh2.A,
        return_p2p=True,
        n_jobs=1,
    )
    print(f"pyFM: {model.descr1.shape[1]} descriptors, {k_start} to {k} eigenfunctions")
    return {
        "coarse": {"source_from_target": model.FM},
        "map": {"source_from_target": refined},
        "matches": {"target_of_source": matches, "n_target": len(target_mesh.vertices)},
    }


def shape(mesh, basis):
    """A mesh of pyFM at total area one, with our eigenpairs."""
    import scipy.sparse
    from pyFM.mesh import TriMesh

    area = basis.mass.sum()
    res = TriMesh(mesh.vertices / np.sqrt(area), mesh.faces.astype(int))
    res.mass = scipy.sparse.diags(basis.mass / area, format="csc")
    res.eigenvalues = basis.eigenvalues * area
    res.eigenvectors = basis.eigenvectors * np.sqrt(area)
    return res


def compare(coarse, refined, matches, errors, bases):
    """One row for each of us: how far the maps are from ours, and what comes of them."""
    ours = [maps[0].source_from_target for maps in (coarse, refined)]
    rows = []
    for index, name in enumerate(["Sinew", "peer"]):
        maps = [maps[index].source_from_target for maps in (coarse, refined)]
        distances = [np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(maps, ours)]
        equal = matches[index].target_of_source == matches[0].target_of_source
        values = bases[index].eigenvalues
        gap = np.abs(values - bases[0].eigenvalues)[1:] / bases[0].eigenvalues[1:]
        rows.append(
            {
                "by": name,
                "fitted map, relative distance": distances[0],
                "refined map, relative distance": distances[1],
                "equal matches [%]": 100.0 * equal.mean(),
                "mean joint error of height [%]": errors[index]["mean of height"][0],
                "largest relative gap of eigenvalues": gap.max(),
            }
        )
    return rows
