// A tiled bathroom: ceiling lamp, mirror lamp, a window of sky, and sun on the floor. No fog.
//
//   povray bathroom.pov +W480 +H480 +FE +Obathroom.exr       (render.py makes the shipped photograph)
//
// Dimensions, colours and lights: numbers.inc. All surfaces are diffuse, all lights are described by
// radiance or irradiance, so that a pixel is a radiance in photo units (1 = photo white).
// Knobs for the command line, as Declare=Name=Value:
//   Global_Illumination  0 direct light only, 1 quick, 2 the photograph (default), 3 slower, for comparison
//   Sublights            per light and side; 3 shows steps in the shadows, 6 hides them (default 6)
//   Reuse_Indirect       1 with +RFI +RFfile: take the indirect light from an earlier render's +RFO +RFfile
//   Emitters_Seen        0 makes lamps and window black where they are seen; what they light stays
//   Ceiling_On, Mirror_On, Sky_On, Sun_On   0 puts a light out; the picture is the sum of its lights
#version 3.7;

#ifndef (Global_Illumination) #declare Global_Illumination = 2; #end
#ifndef (Reuse_Indirect) #declare Reuse_Indirect = 0; #end
#ifndef (Sublights) #declare Sublights = 6; #end
#ifndef (Emitters_Seen) #declare Emitters_Seen = 1; #end
#ifndef (Ceiling_On) #declare Ceiling_On = 1; #end
#ifndef (Mirror_On) #declare Mirror_On = 1; #end
#ifndef (Sky_On) #declare Sky_On = 1; #end
#ifndef (Sun_On) #declare Sun_On = 1; #end

#include "numbers.inc"
#include "lights.inc"
#include "surfaces.inc"

// A tiled white room keeps light alive for long: the recursion limit is the number of bounces, and after
// 7 of them less than 1 % of the light is missing.
global_settings {
  assumed_gamma 1
  #if (Global_Illumination)
    radiosity {
      #switch (Global_Illumination)
        #case (1) count 100 nearest_count 6 error_bound 0.6 recursion_limit 4 pretrace_end 0.02 #break
        #case (2) count 300 nearest_count 8 error_bound 0.5 recursion_limit 7 pretrace_end 0.01 #break
        #else count 600 nearest_count 10 error_bound 0.4 recursion_limit 9 pretrace_end 0.008
      #end
      // Indirect light found by an earlier render (+RFI) is complete: add nothing to it.
      #if (Reuse_Indirect) pretrace_start 1 pretrace_end 1 always_sample off #end
      #if (!Reuse_Indirect) pretrace_start 0.08 #end
      low_error_factor 0.6 minimum_reuse 0.008 maximum_reuse 0.2
      gray_threshold 0 brightness 1 adc_bailout 0.001
    }
  #end
}

background { rgb 0 }

// ---- Camera: given by vectors, so that right-handed world coordinates hold as they stand ----------------
#local Yaw = radians(Camera_Yaw);
#local Pitch = radians(Camera_Pitch);
#local Forward = <sin(Yaw)*cos(Pitch), sin(Pitch), -cos(Yaw)*cos(Pitch)>;
#local Rightward = <cos(Yaw), 0, sin(Yaw)>;
#local Upward = vcross(Rightward, Forward);
#local Focal_Length = 0.5/tan(radians(Camera_Field)/2);       // in widths of the picture
camera {
  location Camera_Position
  direction Focal_Length*Forward
    + (0.5 - Principal_Point.x/Image_Size)*Rightward - (0.5 - Principal_Point.y/Image_Size)*Upward
  right Rightward
  up Upward
}

// ---- Lights --------------------------------------------------------------------------------------------
// A visible emitter shows the radiance that its sub-lights send. It is left out of the radiosity, which
// would count it twice, and casts no shadow on what its own sub-lights or the sun reach.
#macro Emitter(Corner, Edge_1, Edge_2, L)
  polygon {
    5, Corner, Corner + Edge_1, Corner + Edge_1 + Edge_2, Corner + Edge_2, Corner
    texture { pigment { rgb L } finish { ambient 0 diffuse 0 emission Emitters_Seen } }
    no_shadow no_radiosity
  }
#end

#if (Ceiling_On)
  #local L = Exposure*Ceiling_Lamp_Radiance;
  Emitter(Ceiling_Lamp_Corner, Ceiling_Lamp_Edge_1, Ceiling_Lamp_Edge_2, L)
  // vcross(x, z) points to -y.
  Lambertian_Rectangle(Ceiling_Lamp_Corner, Ceiling_Lamp_Edge_1, Ceiling_Lamp_Edge_2, Sublights, Sublights, L)
#end
#if (Mirror_On)
  #local L = Exposure*Mirror_Lamp_Radiance;
  Emitter(Mirror_Lamp_Corner, Mirror_Lamp_Edge_1, Mirror_Lamp_Edge_2, L)
  Lambertian_Rectangle(Mirror_Lamp_Corner, Mirror_Lamp_Edge_1, Mirror_Lamp_Edge_2,
                       2*Sublights, max(2, int(Sublights/3)), L)
#end
#if (Sky_On)
  #local L = Exposure*Sky_Radiance;
  Emitter(Window_Corner, Window_Edge_1, Window_Edge_2, L)
  Lambertian_Rectangle(Window_Corner, Window_Edge_1, Window_Edge_2, Sublights, Sublights, L)
#end
#if (Sun_On)
  Parallel_Sun(Sun_Travel, Exposure*Sun_Irradiance)
#end

// ---- Room ----------------------------------------------------------------------------------------------
#local A = Room_Min;
#local B = Room_Max;
#local T = 0.1;                             // walls are solid outwards; only the window's wall is thin
box { <A.x - T, A.y - T, A.z - T>, <B.x + T, A.y, B.z + T>
      Tiled(Floor_Tile_Size, Floor_Tile_A, Floor_Tile_B, Floor_Grout, x, z) }
box { <A.x - T, B.y, A.z - T>, <B.x + T, B.y + T, B.z + T> Matt(Ceiling_Paint) }
box { <A.x, A.y, A.z - T>, <B.x + T, B.y, A.z> Wall_Tiles(x) }
box { <A.x, A.y, B.z>, <B.x + T, B.y, B.z + T> Wall_Tiles(x) }
box { <B.x, A.y, A.z>, <B.x + T, B.y, B.z> Wall_Tiles(z) }

// The window's wall has no thickness: the opening alone bounds the sun, and its patch is a parallelogram.
// A white ring in the wall's plane reaches to the opening; the tiles begin under the window's frame.
#local W0 = Window_Corner;
#local W1 = Window_Corner + Window_Edge_1 + Window_Edge_2;
#local Gap = 0.015;
#local Frame = 0.06;
#macro Rectangle_With_Hole(Low, High, Hole_Low, Hole_High)
  polygon {
    10, Low, <A.x, Low.y, High.z>, High, <A.x, High.y, Low.z>, Low,
    Hole_Low, <A.x, Hole_Low.y, Hole_High.z>, Hole_High, <A.x, Hole_High.y, Hole_Low.z>, Hole_Low
  }
#end
#local Under = <0, Gap + Frame/2, Gap + Frame/2>;
#local Overlap = <0, 0.01, 0.01>;
object { Rectangle_With_Hole(<A.x, A.y, A.z>, <A.x, B.y, B.z>, W0 - Under, W1 + Under) Wall_Tiles(z) }
object { Rectangle_With_Hole(W0 - Under - Overlap, W1 + Under + Overlap, W0, W1) Matt(White_Trim) }

// ---- Furniture -----------------------------------------------------------------------------------------
// Window frame: stands back from the opening far enough to leave every sunbeam alone.
#local Proud = 0.012;
difference {
  box { <A.x, W0.y - Gap - Frame, W0.z - Gap - Frame>, <A.x + Proud, W1.y + Gap + Frame, W1.z + Gap + Frame> }
  box { <A.x - 1, W0.y - Gap, W0.z - Gap>, <A.x + 1, W1.y + Gap, W1.z + Gap> }
  Matt(White_Trim)
}

// Lamp housings, behind the emitting faces.
#local Back = 0.004;
box { Ceiling_Lamp_Corner + <-0.015, Back, -0.015>,
      <Ceiling_Lamp_Corner.x, B.y, Ceiling_Lamp_Corner.z> + Ceiling_Lamp_Edge_1 + Ceiling_Lamp_Edge_2
      + <0.015, 0, 0.015>
      Matt(White_Trim) }
box { <Mirror_Lamp_Corner.x - 0.012, Mirror_Lamp_Corner.y - 0.012, A.z>,
      Mirror_Lamp_Corner + Mirror_Lamp_Edge_1 + Mirror_Lamp_Edge_2 + <0.012, 0.012, -Back>
      Matt(White_Trim) }

// Tub: an outer box with a rounded basin.
#local Rim = 0.07;
#local Depth = 0.4;
#local Basin = (Tub_Max - Tub_Min)/2 - <Rim, 0, Rim>;
difference {
  box { Tub_Min, Tub_Max }
  superellipsoid {
    <0.35, 0.35>
    scale <Basin.x, 2*Depth, Basin.z>        // half of it stands above the rim, as wide as its middle
    translate <(Tub_Min.x + Tub_Max.x)/2, Tub_Max.y + Depth, (Tub_Min.z + Tub_Max.z)/2>
  }
  Matt(Tub_White)
}

box { Platform_Min, Platform_Max texture { Platform_Stone } }

box { Mirror_Min, Mirror_Max Matt(Mirror_Panel) }
difference {
  box { Mirror_Min - <0.03, 0.03, 0>, Mirror_Max + <0.03, 0.03, 0.008> }
  box { Mirror_Min, Mirror_Max + <0, 0, 1> }
  Matt(<0.20, 0.13, 0.08>)
}

// Door with two sunk panels, a frame and a handle.
difference {
  box { Door_Min, Door_Max }
  box { <Door_Min.x + 0.12, 0.2, Door_Max.z - 0.012>, <Door_Max.x - 0.12, 0.9, 0> }
  box { <Door_Min.x + 0.12, 1.02, Door_Max.z - 0.012>, <Door_Max.x - 0.12, 1.86, 0> }
  texture { Wood_Grain }
}
difference {
  box { Door_Min - <0.06, 0, 0>, Door_Max + <0.06, 0.06, 0.01> }
  box { Door_Min - <0, 1, 1>, Door_Max + <0, 0, 1> }
  Matt(White_Trim)
}
union {
  cylinder { <Door_Max.x - 0.06, 1.0, Door_Max.z>, <Door_Max.x - 0.06, 1.0, Door_Max.z + 0.05>, 0.012 }
  cylinder { <Door_Max.x - 0.06, 1.0, Door_Max.z + 0.05>, <Door_Max.x - 0.17, 1.0, Door_Max.z + 0.05>, 0.011 }
  Matt(<0.45, 0.44, 0.42>)
}

#include "clutter.inc"

// ground truth in fog (make truth) brings the fog along, and takes another camera where it needs one
#ifdef (In_Fog) #include "in_fog.inc" #end
