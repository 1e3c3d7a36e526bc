// The kernels, once for each instruction set they are compiled for; all of them give the same bytes.

#pragma once

#include "arrays.hpp"

namespace guise {

// Their names.
#define GUISE_KERNELS(K) \
    K(brow_shifts) \
    K(colour_planes) \
    K(composite) \
    K(correct_points) \
    K(enlarge) \
    K(expressed) \
    K(filter_shape) \
    K(find_folds) \
    K(fit_cascade) \
    K(gradient_at) \
    K(grain_at) \
    K(judge_points) \
    K(keep_brow) \
    K(lay_over) \
    K(lay_skin) \
    K(lit) \
    K(merge_planes) \
    K(mesh_positions) \
    K(move_light) \
    K(place_points) \
    K(paint_over) \
    K(planar_similarity) \
    K(plausible_motion) \
    K(relief_seen) \
    K(sample_cells) \
    K(sample_picture) \
    K(sample_planes) \
    K(scattered) \
    K(show_through) \
    K(solid_fit) \
    K(texel_sums) \
    K(tint_iris) \
    K(transfer_shape) \
    K(upright_box) \
    K(upright_crop) \
    K(upright_planes) \

// Each has a NumPy twin of the same name, which says what it does: look for `@kernel` in the Python code.
struct Kernels {
    void (*brow_shifts)(Array<const i64> corners, Array<const float> weights, Array<const double> shape,
                        Array<const u8> luma, Array<const float> right, Array<const float> left,
                        Array<const double> limits, Array<const double> costs, Array<double> found);
    void (*colour_planes)(Array<const u8> picture, double middle, Array<float> planes);
    void (*composite)(Array<const u8> texture, Array<const u8> alpha, Array<const double> snapped,
                      Array<const i32> triangles, Array<const double> grid, double opacity, Array<u8> target);
    void (*correct_points)(Array<const double> points, Array<const i64> parts, Array<const float> centre,
                           Array<const float> axes, Array<const float> scale, Array<const float> weights, double most,
                           double full, Array<double> corrected);
    void (*enlarge)(Array<const u8> picture, Array<const float> detail, double contrast, Array<const float> fold,
                    i64 left, i64 top, Array<u8> out);
    void (*expressed)(Array<const float> base, Array<const u16> matrix, Array<const float> away,
                      Array<const float> factors, Array<float> out);
    void (*filter_shape)(Array<const double> shape, Array<const double> gain, Array<const i64> eyes, Array<double> steps,
                         Array<double> filtered);
    i64 (*find_folds)(Array<const double> points, Array<const i32> triangles, Array<const double> to_edges,
                      Array<const u8> closing, Array<const i64> ends, Array<const i64> sides,
                      Array<const double> limits, Array<float> shares, Array<double> edges);
    double (*fit_cascade)(Array<const u8> luma, Array<const double> start, Array<const double> points,
                          Array<const double> rigid, Array<const i64> vertices, Array<const float> weights,
                          Array<const float> mean, Array<const float> basis, Array<const float> deviations,
                          Array<const float> stages, Array<const float> texture_mean,
                          Array<const float> texture_basis, Array<const double> limits, Array<double> shape,
                          Array<double> parameters);
    i64 (*gradient_at)(Array<const u8> picture, Array<const float> places, double sigma, Array<float> energies);
    i64 (*grain_at)(Array<const u8> picture, Array<const float> places, double sigma, i64 box, Array<float> energies);
    double (*judge_points)(Array<const double> points, Array<const double> sigma, double bias, double width,
                           double height, Array<const i64> eyes, Array<const double> rules, Array<float> certain);
    void (*keep_brow)(Array<const i64> corners, Array<const float> weights, Array<const i64> end_corners,
                      Array<const float> end_weights, Array<const double> drawn, Array<const double> at_rest,
                      Array<const float> heights, Array<const float> columns, Array<const double> limits, i64 top,
                      i64 factor, Array<u8> picture);
    void (*lay_over)(Array<const float> own, Array<const float> share, double shown, Array<u8> picture);
    void (*lay_skin)(Array<const u8> roi, Array<const float> cells, Array<const float> share, double sigma, double fold,
                     double amount, Array<u8> picture);
    void (*lit)(Array<const float> texture, Array<const i64> pixels, i64 width, double cell, Array<const float> light,
                Array<const i64> skin, Array<const float> at_rest, Array<const i64> corners,
                Array<const double> corner_shares, Array<const i64> in_parts, Array<const float> shares, Array<const float> parts,
                Array<const float> to_stored, Array<float> planes);
    void (*merge_planes)(Array<const u8> luma, Array<const u8> u, Array<const u8> v, i64 shift_x, i64 shift_y,
                         i64 left, i64 top, Array<u8> out);
    void (*mesh_positions)(Array<const double> points, Array<const i64> vertices, Array<const float> weights,
                           Array<float> places);
    void (*move_light)(Array<const float> sums, Array<const float> at_rest, Array<const float> tone,
                       Array<const double> limits, Array<const float> kept, double share, Array<float> light,
                       Array<float> change);
    void (*place_points)(Array<const float> found, Array<const float> deviations, Array<const double> to_picture,
                         Array<double> points, Array<double> sigma);
    void (*paint_over)(Array<const float> brows, Array<const float> skin, Array<const double> numbers, Array<u8> part);
    void (*planar_similarity)(Array<const double> source, Array<const double> target, Array<const double> weights,
                              Array<double> made);
    i64 (*plausible_motion)(Array<const double> previous, Array<const double> current, Array<const i64> eyes,
                            Array<const double> limits);
    void (*relief_seen)(Array<const double> points, Array<const i64> vertices, Array<const float> weights,
                        Array<const double> depth, Array<const double> across, double beyond, Array<double> seen);
    void (*sample_cells)(Array<const double> points, Array<const i64> corners, Array<const float> weights,
                         Array<const float> depth, Array<const float> across, Array<const float> maps,
                         Array<const double> to_cells, Array<float> places, Array<float> shares);
    void (*sample_picture)(Array<const u8> picture, Array<const float> points, Array<float> colours);
    void (*sample_planes)(Array<const u8> luma, Array<const u8> first, Array<const u8> second,
                          Array<const float> points, Array<const float> to_chroma, Array<const float> to_rgb,
                          Array<float> colours);
    void (*scattered)(Array<const float> planes, Array<const i64> pixels, Array<const i64> beside,
                      Array<const i64> nearest, Array<u8> picture);
    void (*show_through)(Array<const i64> corners, Array<const float> weights, Array<const double> head,
                         Array<const u8> roi, double sharpening, Array<float> places, Array<float> own);
    void (*solid_fit)(Array<const double> points, Array<const double> mean, Array<const double> modes,
                      Array<const double> noise, Array<const double> middle, Array<const double> precision, i64 steps,
                      double outlier, Array<double> rotation, Array<double> place, Array<double> amounts,
                      Array<double> solid);
    void (*texel_sums)(Array<const i64> corners, Array<const double> shares, Array<const float> values,
                       Array<const float> seen, Array<const i64> chosen, Array<const float> weights,
                       Array<float> sums);
    void (*tint_iris)(Array<const float> places, Array<const float> axes, Array<const float> cells,
                      Array<const double> to_cells, Array<const float> lids, Array<const i64> looked_at,
                      Array<const float> to_rgb, Array<const float> from_rgb, Array<const double> moves,
                      Array<const float> factors, Array<const float> profiles, Array<const double> numbers,
                      Array<double> gaze, Array<float> eye);
    void (*transfer_shape)(Array<const double> shape, Array<const double> points, Array<const double> rigid,
                           Array<const double> linear, Array<const double> source, Array<const double> target,
                           Array<const float> centre, Array<const float> scale, Array<const float> weight_0,
                           Array<const float> bias_0, Array<const float> weight_1, Array<const float> bias_1,
                           Array<const float> weight_2, Array<const float> bias_2, Array<const i64> features, i64 held,
                           Array<const i64> lids, Array<const i64> lips, Array<const i64> drawn,
                           Array<const double> limits, Array<double> made);
    void (*upright_box)(Array<const double> points, Array<const i64> eyes, Array<double> made);
    void (*upright_crop)(Array<const u8> picture, Array<const double> to_picture, Array<u8> crop);
    void (*upright_planes)(Array<const u8> luma, Array<const u8> first, Array<const u8> second,
                           Array<const double> to_chroma, Array<const float> to_rgb, Array<const double> to_picture,
                           Array<u8> crop);
};

// Null where the compiler or the processor lacks the instruction set.
const Kernels *plain_kernels();
const Kernels *sse41_kernels();
const Kernels *avx2_kernels();

}  // namespace guise
